"""What an installed package adds to Phalanx: registered, never imported by name."""
