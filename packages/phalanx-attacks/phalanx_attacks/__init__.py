"""Attacks: a search for what breaks a swarm, and the smallest scenario that repeats it."""
