"""Keys, messages, seal and sessions: the only package that imports zenoh."""
