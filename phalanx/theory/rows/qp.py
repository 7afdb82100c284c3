"""The quadratic program of one agent: min ‖u - u_nom‖² in U_i and the safety rows."""

from collections.abc import Sequence

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.models.polytope import Box, Polytope
from phalanx.theory.rows.row import Row, Rows
from phalanx.theory.rows.solver import INFINITY, Solver

TOLERANCE = 1e-6
"""How far a solution may stand outside its constraints, each scaled to a unit normal."""

_FARTHEST = 1e6
"""How many times as far as U_i a nominal input counts."""


class NearestInput:
    """argmin of Σ w (u - u_nom)² over A u <= b and a u <= bound.

    In a box with one row it is a number to find (nearest_in_box); any other is OSQP's. A solver is
    kept for each number of rows that comes, and an answer depends on its question alone.
    """

    def __init__(self, metric: tuple[float, ...], most_steps: int = 20_000) -> None:
        """metric: w, one weight for each input. most_steps: OSQP gives up after so many."""
        self._metric, self._most_steps = metric, most_steps
        self._solvers: dict[int, Solver] = {}

    def solve(
        self, u_nom: Array, polytope: Polytope, row: Row | Rows | None = None
    ) -> Array | None:
        """The nearest input, shape (m,), or None unless it was found and every row holds.

        Args:
            u_nom: shape (m,).
            polytope: U_i.
            row: the safety row or rows; None asks for the projection onto U_i.
        """
        box = polytope.box
        if box is None:
            return self._solved(u_nom, polytope, row)
        if isinstance(row, Row):
            return self._in_box(u_nom, box, row)
        # The metric is diagonal: without rows the nearest input is u_nom clipped.
        clipped = np.minimum(np.maximum(u_nom, box.low), box.high)
        if row is None or (dot(row.a, clipped) <= row.bound).all():
            return clipped
        return self._solved(u_nom, polytope, row)

    def _in_box(self, u_nom: Array, box: Box, row: Row) -> Array | None:
        (low, high), a, wanted = box.ends, row.a.tolist(), u_nom.tolist()
        if max(map(abs, wanted)) > _FARTHEST:
            wanted = _within_reach(u_nom, box).tolist()
        u = nearest_in_box(wanted, self._metric, low, high, a, row.bound, TOLERANCE)
        return None if u is None else np.array(u)

    def _solved(self, u_nom: Array, polytope: Polytope, row: Row | Rows | None) -> Array | None:
        A, b, allowed = polytope.A, polytope.b, polytope.b + min(TOLERANCE, polytope.allowance)
        if row is not None:
            a, bound = np.atleast_2d(row.a), np.atleast_1d(row.bound)
            sizes = length(a)
            if (bound[sizes == 0.0] < 0.0).any() or np.isneginf(bound).any():
                return None
            # Unit normals: rows of ‖a‖ from 1e-5 to 40 would strain the tolerances. A row that no
            # input changes, and that holds, binds nothing.
            scale = np.where(sizes > 0.0, sizes, 1.0)
            bound = np.minimum(bound / scale, INFINITY)
            A, b = np.concatenate((A, a / scale[:, None])), np.concatenate((b, bound))
            allowed = np.concatenate((allowed, bound + TOLERANCE))
        if len(b) not in self._solvers:
            self._solvers[len(b)] = Solver(self._metric, len(b), self._most_steps)
        u = self._solvers[len(b)].solve(u_nom, A, b)
        return u if u is not None and (dot(A, u) <= allowed).all() else None


def _within_reach(u_nom: Array, box: Box) -> Array:
    """u_nom, or the point of its ray beyond which 16 digits do not hold it and the box both.

    The farther out on a ray, the less its nearest input moves.
    """
    farthest = _FARTHEST * max(1.0, float(np.abs([box.low, box.high]).max()))
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

    Plain numbers: so few of them are several times faster than arrays.

    Args:
        tolerance: how far the least aᵀu may be above the bound, over Σ |a|. Then that is the
            answer; beyond it there is none, and None is returned.
    """
    components = [
        (wanted, c / (w + w), least, greatest, c)
        for wanted, w, least, greatest, c in zip(u_nom, weights, low, high, a, strict=True)
    ]
    u, value = _at(components, 0.0)
    if value <= bound:
        return u
    # aᵀu(λ) bends where a component reaches one of its bounds.
    ends = [
        (wanted - end) / slope
        for wanted, slope, least, greatest, _ in components
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
    u, value = [], 0.0
    for wanted, slope, least, greatest, c in components:
        component = wanted - multiplier * slope
        if component < least:
            component = least
        elif component > greatest:
            component = greatest
        u.append(component)
        value += c * component
    return u, value
