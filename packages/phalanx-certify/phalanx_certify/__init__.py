"""phalanx certify: a recording proven safe by code of its own."""
