"""What becomes of every judged event: a recording, a hash, and what viewers see."""
