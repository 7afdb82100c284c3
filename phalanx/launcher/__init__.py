"""A run from scenario to result."""
