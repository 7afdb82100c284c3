"""The nearest point of a polyhedron, defined to the last bit: argmin ‖v - n‖² over G v <= g.

The rows of G have unit length. A set S of rows *passes* if its rows are independent and the point
where they are equalities fulfils the conditions of optimality::

    v = n - G_Sᵀ λ,  G_S v = g_S        (the nearest point of S's subspace)
    λ_k >= -DUAL (1 + Σ|λ|)             for k in S
    G_j v <= g_j + PRIMAL (1 + |g_j|)   for every row j

In real numbers the point is unique. In float64 several sets may pass where rows meet, each with
other last digits; so the answer is that of one set, whatever was tried before it:

1. The dual iteration of Goldfarb and Idnani from no rows: the row that is violated most enters, the
   lower number first if several are. It ends in a set that passes, or in a proof that none does.
2. Of the rows within NEAR of that point, the first set that passes, by size, then by row numbers.

A hint is a set that may be the answer: another solver's, or that of the step before. It is the
answer if it passes *strictly*: its multipliers and the slack of all other rows are so large that no
other set can pass. So hints change the time, never the bits: docs/decisions/8-minimiser.md.

Only + - * / and √ are used, sums run from left to right, so the bits are those of any machine.
nearest_point.c is the same in C, and runs where `phalanx compile` has built it.
"""

import ctypes
from collections.abc import Iterator, Sequence
from itertools import chain, combinations
from math import comb, inf, sqrt
from pathlib import Path
from typing import NamedTuple

import numpy as np

from phalanx.native.library import address, native_source, sample_states
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, inner, length

PRIMAL = 1e-9
"""Allowed excess of a row over its bound, relative to 1 + |bound|."""
DUAL = 1e-9
"""Allowed size of a negative multiplier, relative to 1 + the sum of all."""
INDEPENDENT = 1e-10
"""Least square of a row's part that is orthogonal to the rows before it."""
NEAR = 1e-4
"""Slack and multiplier, relative to √(1 + Σ λ (1 + |g|)), above which a set passes strictly."""
_MOST_SETS = 3000
"""Sets that are tried in order; where more would have to be, the iteration's set is the answer."""
_MOST_STEPS = 1000


Rows = tuple[int, ...]
"""Numbers of rows, in ascending order."""


class NearestPoint(NamedTuple):
    """The point and the rows that it was computed from."""

    v: list[float]
    rows: Rows


class _Optimum(NamedTuple):
    """A set that passes."""

    v: list[float]
    multipliers: list[float]
    slack: Array
    """g - G v"""
    near: float
    """Slack up to which another set's rows may be."""
    determinant: float
    """det G_S G_Sᵀ"""


def nearest_point(n: Sequence[float], G: Array, g: Array, size: float) -> NearestPoint | None:
    """The point of {G v <= g} nearest to n, or None if no set of rows passes.

    Args:
        n: m numbers.
        G: rows of length 1, shape (k, m).
        g: shape (k,).
        size: ‖v‖ of any v that may fulfil all rows.
    """
    rows, empty = _iterate(n, G, g, size)
    if empty:
        return None
    optimum = _passing(n, G, g, rows)
    near = _near(optimum) if optimum else list(range(len(g)))
    if _count(len(near), len(n)) > _MOST_SETS:
        return optimum and NearestPoint(optimum.v, rows)
    for subset in _sets(near, len(n)):
        if first := _passing(n, G, g, subset):
            return NearestPoint(first.v, subset)
    return None


def strictly_nearest(n: Sequence[float], G: Array, g: Array, hint: Rows) -> NearestPoint | None:
    """The nearest point, if these rows pass strictly; else None."""
    optimum = _passing(n, G, g, hint)
    return NearestPoint(optimum.v, hint) if optimum and _strict(optimum, hint) else None


def _count(rows: int, m: int) -> int:
    """The number of sets of at most m of these rows."""
    return sum(comb(rows, size) for size in range(m + 1))


def _sets(rows: Sequence[int], m: int) -> Iterator[Rows]:
    """Sets of at most m rows: by size, then by their numbers."""
    return chain.from_iterable(combinations(rows, size) for size in range(m + 1))


def _near(optimum: _Optimum) -> list[int]:
    return np.flatnonzero(optimum.slack <= optimum.near).tolist()


def _strict(optimum: _Optimum, rows: Rows) -> bool:
    """Return whether no other set can pass."""
    least = optimum.near / sqrt(optimum.determinant)
    return len(_near(optimum)) == len(rows) and min(optimum.multipliers, default=inf) > least


class _Projection(NamedTuple):
    """The point nearest to n where some rows are equalities."""

    v: list[float]
    multipliers: list[float]
    factor: list[list[float]]
    """Of G_S G_Sᵀ, as _factor returns it."""


def _project(n: Sequence[float], G: Array, g: Array, rows: Sequence[int]) -> _Projection | None:
    """Project n onto these rows; None if they are not independent."""
    normals, bounds = G[list(rows)].tolist(), g[list(rows)].tolist()
    if (factor := _factor(normals)) is None:
        return None
    v, multipliers = list(n), [0.0] * len(normals)
    for _ in range(2):  # the second removes the first's rounding, large if n is far away
        step = _solved(factor, [inner(a, v) - b for a, b in zip(normals, bounds, strict=True)])
        multipliers = [old + new for old, new in zip(multipliers, step, strict=True)]
        v = _moved(v, normals, step)
    return _Projection(v, multipliers, factor)


def _passing(n: Sequence[float], G: Array, g: Array, rows: Rows) -> _Optimum | None:
    """The projection onto the rows, if the set passes."""
    if (projection := _project(n, G, g, rows)) is None:
        return None
    v, multipliers, factor = projection
    if min(multipliers, default=0.0) < -DUAL * (1.0 + added(map(abs, multipliers))):
        return None
    slack = g - _products(G, v)
    if (slack < -PRIMAL * (1.0 + np.abs(g))).any():
        return None
    determinant = 1.0
    for k, row in enumerate(factor):
        determinant *= row[k] * row[k]
    products = [l * (1.0 + abs(g[k])) for l, k in zip(multipliers, rows, strict=True)]
    near = NEAR * sqrt(1.0 + added(map(abs, products)))
    return _Optimum(v, multipliers, slack, float(near), determinant)


def _iterate(n: Sequence[float], G: Array, g: Array, size: float) -> tuple[Rows, bool]:
    """The rows at which the dual iteration ends, and whether it proves that no point exists."""
    v, rows, multipliers = list(n), list[int](), list[float]()
    tolerance = PRIMAL * (1.0 + np.abs(g))
    entering = -1
    for _ in range(_MOST_STEPS):
        if entering < 0:
            if (projection := _project(n, G, g, rows)) is None:
                break
            v, multipliers, _ = projection
            excess = _products(G, v) - g - tolerance
            entering = int(excess.argmax())
            if excess[entering] <= 0.0:
                break
        a, normals = G[entering].tolist(), G[rows].tolist()
        if (factor := _factor(normals)) is None:
            break
        change = _solved(factor, [inner(row, a) for row in normals])
        direction = _moved(a, normals, change)
        square, violation = inner(direction, direction), inner(a, v) - float(g[entering])
        ratios = [l / c if c > 0.0 else inf for l, c in zip(multipliers, change, strict=True)]
        first = min(ratios, default=inf)
        whole = violation / square if square > INDEPENDENT else inf
        step = min(first, whole)
        if step == inf:
            weights = 1.0 + added(map(abs, change))
            error = sqrt(square) * (size + sqrt(inner(v, v)))
            return (), violation > weights * float(tolerance.max()) + error
        if whole < inf:
            v = [x - step * d for x, d in zip(v, direction, strict=True)]
        multipliers = [l - step * c for l, c in zip(multipliers, change, strict=True)]
        if step == whole:
            rows.append(entering)
            entering = -1
        else:
            leaving = ratios.index(first)
            del rows[leaving], multipliers[leaving]
    return tuple(sorted(rows)), False


def _factor(normals: Sequence[Sequence[float]]) -> list[list[float]] | None:
    """The Cholesky factor of G_S G_Sᵀ, row by row; None if a row depends on those before it."""
    factor: list[list[float]] = []
    for k, a in enumerate(normals):
        row: list[float] = []
        for j in range(k):
            row.append((inner(a, normals[j]) - inner(row, factor[j])) / factor[j][j])
        square = inner(a, a) - inner(row, row)
        if not square > INDEPENDENT:
            return None
        factor.append([*row, sqrt(square)])
    return factor


def _solved(factor: Sequence[Sequence[float]], right: Sequence[float]) -> list[float]:
    """x of L Lᵀ x = right."""
    x: list[float] = []
    for row, value in zip(factor, right, strict=True):
        x.append((value - inner(row, x)) / row[-1])
    for k in reversed(range(len(x))):
        below = added(factor[j][k] * x[j] for j in range(k + 1, len(x)))
        x[k] = (x[k] - below) / factor[k][k]
    return x


def _moved(
    v: Sequence[float], normals: Sequence[Sequence[float]], steps: Sequence[float]
) -> list[float]:
    """v - G_Sᵀ steps."""
    moved = list(v)
    for a, step in zip(normals, steps, strict=True):
        moved = [x - step * c for x, c in zip(moved, a, strict=True)]
    return moved


def _products(G: Array, v: Sequence[float]) -> Array:
    """G v, its sums from left to right."""
    products = np.zeros(len(G))
    for column, x in zip(G.T, v, strict=True):
        products += column * x
    return products


_MOST_INPUTS = 16
"""M in nearest_point.c; with more, the reference runs."""
LIMITS = np.array([PRIMAL, DUAL, INDEPENDENT, NEAR, _MOST_SETS, _MOST_STEPS])


class NearestPointSolver:
    """nearest_point and strictly_nearest; in C if the cache of compiled functions has them."""

    def __init__(self) -> None:
        self._compiled = compiled_point()

    def in_c(self, inputs: int) -> bool:
        """Return whether programs with this many inputs run in C."""
        return self._compiled is not None and inputs <= _MOST_INPUTS

    def solve(
        self, n: Sequence[float], G: Array, g: Array, size: float, hint: Rows | None = None
    ) -> NearestPoint | None:
        """strictly_nearest if there is a hint, else nearest_point."""
        if hint is not None and len(hint) > len(n):
            return None
        if self._compiled is not None and len(n) <= _MOST_INPUTS:
            return self._compiled(n, G, g, size, hint)
        return _reference(n, G, g, size, hint)


def _reference(
    n: Sequence[float], G: Array, g: Array, size: float, hint: Rows | None
) -> NearestPoint | None:
    return nearest_point(n, G, g, size) if hint is None else strictly_nearest(n, G, g, hint)


def compiled_point() -> "CompiledPoint | None":
    """Return the same in C; None if the cache of compiled functions lacks it."""
    return native_source(Path(__file__).with_suffix(".c").read_text("utf-8"), CompiledPoint)


class CompiledPoint:
    """The same in C."""

    def __init__(self, library: ctypes.PyDLL) -> None:
        """Raise ValueError unless the bits are the reference's."""
        self.function = library.nearest_point
        for m, k in ((1, 3), (2, 4), (2, 9), (3, 6), (3, 12), (4, 9)):
            numbers = sample_states(m + k * m + k)[m]
            n, g, G = numbers[:m].tolist(), abs(numbers[m : m + k]), numbers[m + k :].reshape(k, m)
            program = n, G / length(G)[:, None], g, 9.0
            for hint in (None, (0,)):
                if self(*program, hint) != _reference(*program, hint):
                    raise ValueError("nearest_point.c computes other bits")

    def __call__(
        self, n: Sequence[float], G: Array, g: Array, size: float, hint: Rows | None
    ) -> NearestPoint | None:
        k, m = G.shape
        G, g = np.ascontiguousarray(G), np.ascontiguousarray(g)
        floats, rows = np.empty(m + m + k), np.empty(m + 2 * k, dtype=np.int32)
        floats[:m] = n
        if hint is not None:
            rows[: len(hint)] = hint
        count = self.function(
            m,
            k,
            address(floats),
            address(G),
            address(g),
            ctypes.c_double(size),
            -1 if hint is None else len(hint),
            address(LIMITS),
            address(rows),
        )
        if count < 0:
            return None
        return NearestPoint(floats[m : 2 * m].tolist(), tuple(rows[:count].tolist()))
