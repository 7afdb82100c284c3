"""The true state of all agents, and what the safe set says of it."""
