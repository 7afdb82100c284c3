"""A process that ends with its parent, however that ends."""

import ctypes
import signal

_PR_SET_PDEATHSIG = 1
"""Of Linux's prctl."""


def end_with_parent() -> None:
    """Have the kernel kill this process when its parent ends, in any state."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
