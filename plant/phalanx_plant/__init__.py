"""The plant's process: the world, the clock, the hub and the truth."""
