"""Studies: many runs of one scenario, planned, computed anywhere, and kept."""
