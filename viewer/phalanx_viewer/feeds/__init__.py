"""Where frames come from: a live run over Zenoh, or a recording."""
