"""Knowledge of peers by radio: sets of their states, gaps, and inputs that keep these."""
