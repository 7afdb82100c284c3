"""What can go wrong in a run besides its links: commands, and the state that they leave behind."""
