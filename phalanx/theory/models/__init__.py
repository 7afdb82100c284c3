"""Dynamics, output points and input polytopes."""
