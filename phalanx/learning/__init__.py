"""Swarms as environments for learned agents, by the interface of PettingZoo (an extra)."""
