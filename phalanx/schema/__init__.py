"""What the tables of a scenario are made of: validated fields, and classes by name."""
