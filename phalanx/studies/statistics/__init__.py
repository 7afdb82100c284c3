"""Statistics of repeated runs: intervals that cover as they say. Nothing here knows of runs."""
