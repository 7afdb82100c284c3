"""Consumers of judged events: the recording, the trajectory's hash, and frames for viewers."""
