"""Verdict on the safe set, and the assumptions behind a guarantee and the theorem."""
