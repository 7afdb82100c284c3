"""Nominal laws and attacks: what an agent would like to apply."""
