"""Randomness: counter-based draws, each keyed by its purpose, and perturbed clocks."""
