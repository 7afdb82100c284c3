"""Sampling times, the content of samples, and the broadcasts that exist for each agent."""
