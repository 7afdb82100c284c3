"""The nearest input of a box that keeps one row, to the last bit.

Only one number is unknown: the row's multiplier λ >= 0. The nearest input is u_k(λ) = u_nom_k - λ
a_k / (2 w_k), clipped to its bounds. aᵀu(λ) is piecewise linear and falls from its value at the
clipped nominal input to the least in the box, so λ lies on the piece that crosses the bound: no
iteration, and nothing that could fail to converge.

nearest_in_box.c is the same in C, and runs where `phalanx compile` has built it.
"""

import ctypes
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from phalanx.native.library import address, native_source, sample_states
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added
from phalanx.theory.models.polytope import Box
from phalanx.theory.rows.row import Row

TOLERANCE = 1e-6
"""Allowed violation of one row in a box, scaled to a unit normal."""
FARTHEST = 1e6
"""Nominal inputs are moved to within this many times the size of U_i."""


class NearestInBox:
    """nearest_in_box for one metric; in C if the cache of compiled functions has it."""

    def __init__(self, metric: Sequence[float]) -> None:
        self._compiled, self._metric = compiled_nearest(), metric
        self._numbers = _program(metric)
        self._place = address(self._numbers)

    def solve(self, u_nom: Array, box: Box, row: Row) -> Array | None:
        """The nearest input, shape (m,), or None if none keeps the row."""
        if max(map(abs, u_nom.tolist())) > FARTHEST:
            u_nom = _within_reach(u_nom, box)
        if self._compiled is None:
            (low, high), a, nominal = box.ends, row.a.tolist(), u_nom.tolist()
            u = nearest_in_box(nominal, self._metric, low, high, a, row.bound, TOLERANCE)
            return None if u is None else np.array(u)
        numbers = self._numbers
        numbers[0], numbers[2], numbers[3], numbers[4] = u_nom, box.low, box.high, row.a
        exists = self._compiled(len(u_nom), self._place, row.bound, TOLERANCE)
        return numbers[5].copy() if exists else None


Compiled = Callable[[int, Any, float, float], int]


def _program(metric: Sequence[float]) -> Array:
    """Room for a program as nearest_in_box.c takes it, with its weights."""
    numbers = np.empty((8, len(metric)))
    numbers[1] = metric
    return numbers


def compiled_nearest() -> Compiled | None:
    """The function in C; None if the cache of compiled functions lacks it."""
    source = Path(__file__).with_suffix(".c").read_text("utf-8")
    return native_source(source, _checked)


def _checked(library: ctypes.PyDLL) -> Compiled:
    """The function of a library. Raises ValueError unless its bits are the reference's."""
    function = library.nearest_in_box
    function.argtypes = ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double
    for m in (1, 2, 3, 5):
        for sample in sample_states(5 * m + 1)[::5]:
            numbers, bound = _program(abs(sample[:m])), float(sample[-1])
            numbers[[0, 4, 2, 3]] = sample[m:-1].reshape(4, m)
            numbers[2:4].sort(axis=0)
            u_nom, weights, low, high, a = numbers[:5].tolist()
            u = nearest_in_box(u_nom, weights, low, high, a, bound, TOLERANCE)
            exists = function(m, address(numbers), bound, TOLERANCE)
            if (numbers[5].tolist() if exists else None) != u:
                raise ValueError("nearest_in_box.c computes other bits")
    compiled: Compiled = function
    return compiled


def _within_reach(u_nom: Array, box: Box) -> Array:
    """u_nom, or a nearer point on its ray if u_nom is too large for float64's digits.

    The farther out on a ray, the less its nearest input moves.
    """
    farthest = FARTHEST * max(1.0, float(np.abs([box.low, box.high]).max()))
    nearer: Array = u_nom * min(1.0, farthest / float(np.abs(u_nom).max()))
    return nearer


_Component = tuple[float, float, float, float, float]
"""u_nom, -du/dλ, least, greatest, a"""


def nearest_in_box(
    u_nom: Sequence[float],
    weights: Sequence[float],
    low: Sequence[float],
    high: Sequence[float],
    a: Sequence[float],
    bound: float,
    tolerance: float,
) -> list[float] | None:
    """argmin of Σ w (u - u_nom)² over low <= u <= high and aᵀu <= bound, each of m numbers.

    Lists: for so few numbers they are several times faster than arrays.

    Args:
        tolerance: allowed excess of the least aᵀu over the bound, per Σ |a|; up to it the input
            with the least aᵀu is returned, beyond it None.
    """
    components = [
        (nominal, c / (w + w), least, greatest, c)
        for nominal, w, least, greatest, c in zip(u_nom, weights, low, high, a, strict=True)
    ]
    u, value = _at(components, 0.0)
    if value <= bound:
        return u
    # aᵀu(λ) bends where a component reaches one of its bounds.
    ends = [
        (nominal - end) / slope
        for nominal, slope, least, greatest, _ in components
        if slope != 0.0
        for end in (least, greatest)
    ]
    begin = 0.0
    for end in sorted(ends):
        if end <= 0.0:
            continue
        u, then = _at(components, end)
        if then <= bound:
            return _at(components, begin + (end - begin) * (value - bound) / (value - then))[0]
        begin, value = end, then
    return u if value - bound <= tolerance * added(map(abs, a)) else None


def _at(components: Sequence[_Component], multiplier: float) -> tuple[list[float], float]:
    """u(λ) and aᵀu(λ)."""
    u = [
        least
        if (free := nominal - multiplier * slope) < least
        else (greatest if free > greatest else free)
        for nominal, slope, least, greatest, _ in components
    ]
    value = 0.0
    for component, (*_, c) in zip(u, components, strict=True):
        value += c * component
    return u, value
