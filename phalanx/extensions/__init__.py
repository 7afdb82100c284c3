"""Additions of installed packages: registered, never imported by name."""
