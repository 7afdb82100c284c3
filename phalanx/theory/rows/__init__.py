"""Rows: the inequalities that an agent's input must satisfy, and the input that does."""
