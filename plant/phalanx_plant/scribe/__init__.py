"""What happened, written down and shown."""
