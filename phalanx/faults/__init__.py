"""Faults of a run: a family of [[faults]] in each file, and commands."""
