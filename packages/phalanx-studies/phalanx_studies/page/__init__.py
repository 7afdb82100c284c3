"""The page of a study: rates, distributions and rows, as one HTML file that needs nothing else."""
