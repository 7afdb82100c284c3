"""A recorded run for other tools, in Foxglove's messages."""
