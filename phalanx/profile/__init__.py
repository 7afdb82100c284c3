"""A stopwatch for programs."""
