"""The quadratic program of one agent: min ‖u - u_nom‖² in U_i and the safety rows::

    minimise    Σ_k w_k (u_k - u_nom_k)²     over u in R^m; w: the dynamics' metric
    subject to  A u    <= b                  U_i, the input polytope
                a_r u  <= bound_r            one row for h_tot, or one for each pair r

In a box with one row nearest_in_box knows the answer. For all other programs nearest_point computes
it, from rows that were active before or that OSQP names, or without them.
"""

from math import inf, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.least_violation import LeastVertex, least_violation
from phalanx.theory.rows.nearest_in_box import FARTHEST, NearestInBox
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


class NearestInput:
    """argmin of Σ w (u - u_nom)² over A u <= b and a u <= bound, defined to the bit.

    In a box with one row by nearest_in_box, else by nearest_point; its hints are the rows that were
    active last and, where it is not compiled, those that OSQP names. A result depends on the
    arguments alone.

    >>> from phalanx.theory.models.polytope import polytope
    >>> U = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    >>> NearestInput(metric=(1.0, 1.0)).solve(np.array([3.0, 0.5]), U)
    array([1. , 0.5])
    """

    def __init__(self, metric: tuple[float, ...]) -> None:
        """metric: w, one weight for each input."""
        self._metric, self._roots = metric, np.sqrt(np.array(metric))
        self._exact, self._in_box = NearestPointSolver(), NearestInBox(metric)
        self._least_vertex = LeastVertex()
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
            return self._in_box.solve(u_nom, box, row)
        # The metric is diagonal: without rows the nearest input is u_nom clipped.
        clipped = box.nearest(u_nom)
        if row is None or np.logical_and.reduce(dot(row.a, clipped) <= row.bound):
            return clipped
        u = self._solved(u_nom, polytope, row)
        return None if u is None else box.nearest(u)

    def least_violation(self, polytope: Polytope, rows: Rows) -> Array:
        """The input with the least worst violation, shape (m,), for rows that none keeps."""
        return least_violation(polytope, rows, self._least_vertex)

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
        if (farthest := FARTHEST * max(1.0, size)) < (largest := float(np.abs(n).max())):
            n *= farthest / largest
        v = self._nearest(n, A / scale[:, None], g, size)
        return None if v is None else np.array(v) / self._roots

    def _nearest(self, n: Array, G: Array, g: Array, size: float) -> list[float] | None:
        program, rows = (n.tolist(), G, g, size), len(g)
        point = self._exact.solve(*program, self._active.get(rows, ()))
        # In C the whole search takes less time than OSQP's hint.
        if point is None and not self._exact.in_c(len(n)):
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
