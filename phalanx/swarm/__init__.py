"""A scenario's theory objects."""
