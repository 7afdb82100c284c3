"""Messages between programs, their keys and seals, and a program's membership in a run."""
