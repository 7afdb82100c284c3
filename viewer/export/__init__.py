"""A run as a file to share: one HTML document that plays by itself, or a still picture."""
