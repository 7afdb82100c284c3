"""Certify a recorded run, by code that shares scenario, dynamics and h with it, and little else."""
