"""What goes wrong in a run: [[faults]], a family of them in each file, and commands."""
