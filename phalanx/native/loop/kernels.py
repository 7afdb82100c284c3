"""The compiled functions of a run, by their places in memory."""

import ctypes
from collections.abc import Iterable
from itertools import accumulate
from typing import Any

import casadi as ca

from phalanx.native.library import native
from phalanx.theory.expressions.compiled import CompiledFunction, MappedFunction


class Kernels:
    """Finds the compiled form of functions, and keeps it."""

    def __init__(self) -> None:
        self.complete = True
        """Whether all that was asked for is compiled."""
        self._kept: list[Any] = []

    def __call__(self, function: CompiledFunction | MappedFunction | ca.Function | None) -> int:
        """Return a function's place; 0 for none."""
        if function is None:
            return 0
        found = native(function) if isinstance(function, ca.Function) else function.compiled
        return self.place(found and found.rows)

    def place(self, function: Any) -> int:
        """Return the place of a C function; 0 for None: it is not compiled."""
        if function is None:
            self.complete = False
            return 0
        self._kept.append(function)
        return ctypes.cast(function, ctypes.c_void_p).value or 0


def begins(sizes: Iterable[int]) -> list[int]:
    """Return where each of some lists begins in the list of all, and its end."""
    return [0, *accumulate(sizes)]
