"""How large a number may be: beyond it sums and figures of it are infinite."""

LARGEST = 1e300
"""Of what an agent says of itself, of a law's input, and of the world's state."""
LARGEST_SUM = 1e303
"""Of what is worked out from a few of those, and recorded."""
