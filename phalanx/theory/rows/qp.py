"""The quadratic program of one agent: min ‖u - u_nom‖² in U_i and the safety rows::

    minimise    Σ_k w_k (u_k - u_nom_k)²     over u in R^m; w: the dynamics' metric
    subject to  A u    <= b                  U_i, the input polytope
                a_r u  <= bound_r            one row for h_tot, or one for each pair r

In a box with one row only one number is unknown: the row's multiplier λ >= 0. The nearest input is
u_k(λ) = u_nom_k - λ a_k / (2 w_k), clipped to its bounds. aᵀu(λ) is piecewise linear and falls from
its value at the clipped nominal input to the least in the box, so λ lies on the piece that crosses
the bound: no iteration, and nothing that could fail to converge. For all other programs OSQP names
rows that may be active, and nearest_point computes the answer from them, or without them.
"""

from collections.abc import Sequence
from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.models.polytope import Box, Polytope
from phalanx.theory.rows.nearest_point import NearestPointSolver
from phalanx.theory.rows.osqp_without_scipy import compiled_part, without_scipy
from phalanx.theory.rows.row import Row, Rows

Indices = NDArray[np.integer[Any]]

_OSQP = compiled_part()
"""Loaded before the programs are forked, so that they share it."""
INFINITY = 1e30
"""OSQP's infinity: a row with this bound never binds."""
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-5,
    "eps_rel": 1e-5,
    "max_iter": 200,
    "check_termination": 10,
    "scaling": 0,
}
_ACTIVE = 1e-4
"""Multiplier above which a row counts as active."""


class ActiveRows:
    """OSQP's opinion which rows of a program bind; for programs of one size.

    Its sparsity pattern is dense and fixed, so that updates with zeros are right.
    """

    def __init__(self, rows: int, inputs: int) -> None:
        osqp = _OSQP
        settings = osqp.OSQPSettings()
        osqp.osqp_set_default_settings(settings)
        for name, value in _SETTINGS.items():
            setattr(settings, name, value)
        squares = _columns(np.ones((1, inputs)), np.arange(inputs)[None], inputs)
        constraints = _columns(np.ones((rows, inputs)), np.indices((rows, inputs))[0], rows)
        with without_scipy():
            P, A = osqp.CSC(squares), osqp.CSC(constraints)
        low, high, q = np.full(rows, -INFINITY), np.ones(rows), np.zeros(inputs)
        self._solver = osqp.OSQPSolver(P, q, A, low, high, rows, inputs, settings)

    def guess(self, n: Array, G: Array, g: Array) -> tuple[int, ...]:
        """Rows with a multiplier, of argmin ‖v - n‖² over G v <= g."""
        self._solver.update_data_vec(q=-n, l=None, u=g)
        self._solver.update_data_mat(P_x=None, P_i=None, A_x=G.ravel(order="F"), A_i=None)
        self._solver.solve()
        return tuple(np.flatnonzero(np.array(self._solver.solution.y) > _ACTIVE).tolist())


class _Columns(NamedTuple):
    """A sparse matrix, column by column, in OSQP's form."""

    shape: tuple[int, int]
    nnz: int
    indptr: Indices
    """First index of each column."""
    indices: Indices
    """Row of each number."""
    data: Array


def _columns(values: Array, rows: Indices, height: int) -> _Columns:
    """A matrix of columns with equally many numbers; values and their rows have one shape."""
    count, width = values.shape
    begins = np.arange(0, count * width + 1, count, dtype=np.int32)
    indices = rows.ravel(order="F").astype(np.int32)
    return _Columns((height, width), values.size, begins, indices, values.ravel(order="F"))


TOLERANCE = 1e-6
"""Allowed violation of one row in a box, scaled to a unit normal."""

_FARTHEST = 1e6
"""Nominal inputs are moved to within this many times the size of U_i."""


class NearestInput:
    """argmin of Σ w (u - u_nom)² over A u <= b and a u <= bound, defined to the bit.

    In a box with one row by nearest_in_box, else by nearest_point; the rows that were active last
    and those that OSQP names are its hints. A result depends on the arguments alone.

    >>> from phalanx.theory.models.polytope import polytope
    >>> U = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    >>> NearestInput(metric=(1.0, 1.0)).solve(np.array([3.0, 0.5]), U)
    array([1. , 0.5])
    """

    def __init__(self, metric: tuple[float, ...]) -> None:
        """metric: w, one weight for each input."""
        self._metric, self._roots = metric, np.sqrt(np.array(metric))
        self._exact = NearestPointSolver()
        self._osqp: dict[int, ActiveRows] = {}
        self._active: dict[int, tuple[int, ...]] = {}
        """The rows that were active last, by the number of rows."""

    def solve(
        self, u_nom: Array, polytope: Polytope, row: Row | Rows | None = None
    ) -> Array | None:
        """The nearest input, shape (m,), or None if none keeps every row.

        Args:
            u_nom: shape (m,).
            polytope: U_i.
            row: the safety row or rows; None for the projection onto U_i.
        """
        box = polytope.box
        if box is None:
            return self._solved(u_nom, polytope, row)
        if isinstance(row, Row):
            return self._in_box(u_nom, box, row)
        # The metric is diagonal: without rows the nearest input is u_nom clipped.
        clipped = box.nearest(u_nom)
        if row is None or np.logical_and.reduce(dot(row.a, clipped) <= row.bound):
            return clipped
        u = self._solved(u_nom, polytope, row)
        return None if u is None else box.nearest(u)

    def _in_box(self, u_nom: Array, box: Box, row: Row) -> Array | None:
        (low, high), a, nominal = box.ends, row.a.tolist(), u_nom.tolist()
        if max(map(abs, nominal)) > _FARTHEST:
            nominal = _within_reach(u_nom, box).tolist()
        u = nearest_in_box(nominal, self._metric, low, high, a, row.bound, TOLERANCE)
        return None if u is None else np.array(u)

    def _solved(self, u_nom: Array, polytope: Polytope, row: Row | Rows | None) -> Array | None:
        """Solve for v_k = √w_k u_k, with U_i's rows first, then the others as they are given."""
        A, b = polytope.A, polytope.b
        if row is not None:
            A = np.concatenate((A, np.atleast_2d(row.a)))
            b = np.concatenate((b, np.atleast_1d(row.bound)))
        A = A / self._roots
        sizes = length(A)
        zero = sizes == 0.0  # such a row never binds, or cannot be kept
        scale = np.where(zero, 1.0, sizes)
        g = np.minimum(b / scale, INFINITY)
        if (b[zero] < 0.0).any() or not ((sizes < np.inf) & (g > -INFINITY)).all():
            return None
        n, size = self._roots * u_nom, self._size(polytope)
        if (farthest := _FARTHEST * max(1.0, size)) < (largest := float(np.abs(n).max())):
            n *= farthest / largest
        v = self._nearest(n, A / scale[:, None], g, size)
        return None if v is None else np.array(v) / self._roots

    def _nearest(self, n: Array, G: Array, g: Array, size: float) -> list[float] | None:
        program, rows = (n.tolist(), G, g, size), len(g)
        point = self._exact.solve(*program, self._active.get(rows, ()))
        if point is None:
            if rows not in self._osqp:
                self._osqp[rows] = ActiveRows(*G.shape)
            point = self._exact.solve(*program, self._osqp[rows].guess(n, G, g))
        if point is None and (point := self._exact.solve(*program)) is None:
            return None
        self._active[rows] = point.rows
        return point.v

    def _size(self, polytope: Polytope) -> float:
        """The largest ‖v‖ in U_i; ∞ if its corners are not known."""
        if polytope.box is not None:
            farthest = zip(*polytope.box.ends, self._metric, strict=True)
            return sqrt(added(max(a * a, b * b) * w for a, b, w in farthest))
        return float(length(polytope.corners * self._roots).max()) if len(polytope.corners) else inf


def _within_reach(u_nom: Array, box: Box) -> Array:
    """u_nom, or a nearer point on its ray if u_nom is too large for float64's digits.

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
