"""What is proven before a run, and what a run's end may claim."""
