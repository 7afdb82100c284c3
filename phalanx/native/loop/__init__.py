"""The native loop: whole runs in C, with no object of Python in a step, and the same bits."""
