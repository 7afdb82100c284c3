"""What happens in a run, and what ends it early."""
