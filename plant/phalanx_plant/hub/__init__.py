"""The plant's side of the wire."""
