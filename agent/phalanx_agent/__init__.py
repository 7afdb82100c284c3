"""One agent's process, normal or adversary: sample, decide, broadcast."""
