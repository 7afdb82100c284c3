"""Branches of a run, which say from when on a violation was inevitable (phalanx branch)."""
