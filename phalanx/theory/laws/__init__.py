"""Nominal laws and attacks."""
