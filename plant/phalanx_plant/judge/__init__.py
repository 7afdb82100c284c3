"""Was the safe set kept, and what a guarantee and the theorem assume."""
