"""Controllers other than the paper's filter: their protocol, and the check of their inputs."""
