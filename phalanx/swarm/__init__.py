"""The facts of a scenario, and the one builder of its rows."""
