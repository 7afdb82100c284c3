"""Worlds of other projects' models of robots."""
