"""The report on a run: the paper's figures, and one HTML file that needs nothing else."""
