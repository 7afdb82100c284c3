"""Keys, messages, sessions and link faults: the only place that imports zenoh."""
