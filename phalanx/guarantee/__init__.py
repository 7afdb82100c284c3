"""Certificates, the check of a scenario before a run, and the verdict on a run."""
