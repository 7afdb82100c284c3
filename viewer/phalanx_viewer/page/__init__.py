"""The page in the browser: its server, panels and commands, and their loop."""
