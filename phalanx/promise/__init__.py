"""A promise before a run: a fallback of each agent's that no other can keep it from."""
