"""The recording of a run: one MCAP file, readable up to its last chunk after a crash."""
