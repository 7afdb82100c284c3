"""The true state of all agents, and the safe-set functions evaluated at it."""
