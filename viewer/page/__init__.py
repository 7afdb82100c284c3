"""The page in the browser: its server, panels, plots, timeline and commands, and their loop."""
