"""Nominal laws, attacks, and controllers in place of the paper's filter."""
