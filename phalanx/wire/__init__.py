"""Keys, messages, seal and sessions: the only place that imports zenoh."""
