"""The recording of a run: one MCAP file, readable after a crash up to its last chunk."""
