"""The quadratic program of one agent: min ‖u - u_nom‖² in U_i and the safety rows::

    minimise    Σ_k w_k (u_k - u_nom_k)²     over u in R^m; w: the dynamics' metric
    subject to  A u    <= b                  U_i, the input polytope
                a_r u  <= bound_r            one row for h_tot, or one for each pair r

In a box with one row nearest_in_box knows the answer. For all other programs nearest_point computes
it, from the rows that were active at the step before, or without them.
"""

from math import inf, sqrt

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.least_violation import LeastVertex, least_violation
from phalanx.theory.rows.nearest_in_box import FARTHEST, NearestInBox
from phalanx.theory.rows.nearest_point import NearestPointSolver
from phalanx.theory.rows.row import Row, Rows

INFINITY = 1e30
"""A row with this bound never binds."""


class NearestInput:
    """argmin of Σ w (u - u_nom)² over A u <= b and a u <= bound, defined to the bit.

    In a box with one row by nearest_in_box, else by nearest_point, with the rows that were active
    last as a hint. A result depends on the arguments alone.

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
