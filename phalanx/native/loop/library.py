"""The loop in C, compiled and loaded."""

import ctypes

import numpy as np

from phalanx.native.library import address, native_source
from phalanx.native.loop.memory import source
from phalanx.native.loop.rules import words_of
from phalanx.network.draws import Draws, key_of


def compiled_loop() -> ctypes.PyDLL | None:
    """Return the loop; None if the cache of compiled functions lacks it."""
    return native_source(source(), _checked)


def _checked(library: ctypes.PyDLL) -> ctypes.PyDLL:
    """Return the library. Raises ValueError unless it draws what NumPy draws."""
    for width in (1, 2, 3):
        key = np.array(words_of(key_of(width, ("checked",))), np.uint64).view(np.float64)
        rows, draws = np.empty((300, width)), Draws(width, "checked", width=width)
        counts = (ctypes.c_longlong(n) for n in (100, len(rows), width))
        library.draw_rows(address(key), *counts, address(rows))
        if any((row != draws[100 + k]).any() for k, row in enumerate(rows)):
            raise ValueError("draws.c draws other bits")
    return library
