"""Evidence on other agents: checks of what they broadcast against how they move."""
