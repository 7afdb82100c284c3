"""Where a program's wall time goes."""
