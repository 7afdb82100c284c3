"""Whom a hub lets in, and what each may do there."""
