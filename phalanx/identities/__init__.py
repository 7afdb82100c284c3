"""Admission of programs by a hub, and their permissions."""
