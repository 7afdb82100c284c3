"""Faults of a run: one family of [[faults]] per file, and commands."""
