"""Zenoh sessions, publishers and liveliness: the only package that imports zenoh."""
