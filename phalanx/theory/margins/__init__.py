"""Margins: how much stricter a row is, so that it holds until the next sample."""
