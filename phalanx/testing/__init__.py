"""Checks that code of your own keeps what its protocol says."""

from phalanx.testing.worlds import WorldMistakeError, check_world

__all__ = ["WorldMistakeError", "check_world"]
