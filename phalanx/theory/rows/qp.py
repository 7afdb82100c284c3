"""The quadratic program of one agent: min ‖u - u_nom‖² in U_i and the safety rows::

    minimise    Σ_k w_k (u_k - u_nom_k)²     over u in R^m; w: the dynamics' metric
    subject to  A u    <= b                  U_i, the input polytope
                a_r u  <= bound_r            one row for h_tot, or one for each pair r

In a box with one row only one number is unknown: the row's multiplier λ >= 0. The nearest input is
u_k(λ) = u_nom_k - λ a_k / (2 w_k), clipped to its bounds. aᵀu(λ) is piecewise linear and falls from
its value at the clipped nominal input to the least in the box, so λ lies on the piece that crosses
the bound: no iteration, and nothing that could fail to converge. OSQP solves all other programs.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.models.polytope import Box, Polytope
from phalanx.theory.rows.osqp_without_scipy import compiled_part, without_scipy
from phalanx.theory.rows.row import Row, Rows

Indices = NDArray[np.integer[Any]]

_OSQP = compiled_part()
"""Loaded before the programs are forked, so that they share it."""
INFINITY = 1e30
"""OSQP's infinity: a row with this bound never binds."""
_RHO = 0.1
_STEEPEST = 1e4
"""Objectives with a larger linear part are scaled down to it."""
_SETTINGS = {
    "verbose": False,
    "eps_abs": 1e-6,
    "eps_rel": 1e-8,
    "polishing": True,
    "check_termination": 10,
    "adaptive_rho": True,
    "adaptive_rho_interval": 50,
    "warm_starting": False,
    "rho": _RHO,
    "scaling": 0,
}


class Solver:
    """An OSQP solver for programs of one size.

    Its sparsity pattern is dense and fixed, so that updates with zeros are right. Adaptive ρ counts
    iterations, not time, and starts again for each program, so that no result depends on earlier
    ones.
    """

    def __init__(self, metric: tuple[float, ...], rows: int, most_steps: int) -> None:
        """metric: w, one weight for each input. most_steps: limit of iterations."""
        self._weights, inputs = np.array(metric), len(metric)
        osqp = _OSQP
        settings = osqp.OSQPSettings()
        osqp.osqp_set_default_settings(settings)
        for name, value in {**_SETTINGS, "max_iter": most_steps}.items():
            setattr(settings, name, value)
        self._solved = int(osqp.osqp_status_type.OSQP_SOLVED)
        squares = _columns(2.0 * self._weights[None], np.arange(inputs)[None], inputs)
        constraints = _columns(np.ones((rows, inputs)), np.indices((rows, inputs))[0], rows)
        with without_scipy():
            P, A = osqp.CSC(squares), osqp.CSC(constraints)
        self._solver = osqp.OSQPSolver(
            P,
            np.zeros(inputs),
            A,
            np.full(rows, -INFINITY),
            np.ones(rows),
            rows,
            inputs,
            settings,
        )

    def solve(self, u_nom: Array, A: Array, b: Array) -> Array | None:
        """argmin of Σ w (u - u_nom)² over A u <= b, or None if OSQP did not solve it."""
        # Scaling the objective leaves the argmin where it is; OSQP gives up on slopes of 10⁶.
        steepest = 2.0 * float(np.abs(self._weights * u_nom).max())
        quadratic = 2.0 * self._weights * (_STEEPEST / max(steepest, _STEEPEST))
        self._solver.update_rho(_RHO)
        self._solver.update_data_vec(q=-quadratic * u_nom, l=None, u=b)
        self._solver.update_data_mat(P_x=quadratic, P_i=None, A_x=A.ravel(order="F"), A_i=None)
        self._solver.solve()
        if self._solver.info.status_val != self._solved:
            return None
        return np.array(self._solver.solution.x)


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
"""Allowed violation of constraints by a solution, each scaled to a unit normal."""

_FARTHEST = 1e6
"""Nominal inputs are moved to within this many times the size of U_i."""


class NearestInput:
    """argmin of Σ w (u - u_nom)² over A u <= b and a u <= bound.

    In a box with one row by nearest_in_box, else by OSQP. A solver is kept for each number of rows;
    a result depends on the arguments alone.

    >>> from phalanx.theory.models.polytope import polytope
    >>> U = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    >>> NearestInput(metric=(1.0, 1.0)).solve(np.array([3.0, 0.5]), U)
    array([1. , 0.5])
    """

    def __init__(self, metric: tuple[float, ...], most_steps: int = 20_000) -> None:
        """metric: w, one weight for each input. most_steps: limit of OSQP's iterations."""
        self._metric, self._most_steps = metric, most_steps
        self._solvers: dict[int, Solver] = {}

    def solve(
        self, u_nom: Array, polytope: Polytope, row: Row | Rows | None = None
    ) -> Array | None:
        """The nearest input, shape (m,), or None unless it was found and every row holds.

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
        clipped = np.minimum(np.maximum(u_nom, box.low), box.high)
        if row is None or np.logical_and.reduce(dot(row.a, clipped) <= row.bound):
            return clipped
        return self._solved(u_nom, polytope, row)

    def _in_box(self, u_nom: Array, box: Box, row: Row) -> Array | None:
        (low, high), a, nominal = box.ends, row.a.tolist(), u_nom.tolist()
        if max(map(abs, nominal)) > _FARTHEST:
            nominal = _within_reach(u_nom, box).tolist()
        u = nearest_in_box(nominal, self._metric, low, high, a, row.bound, TOLERANCE)
        return None if u is None else np.array(u)

    def _solved(self, u_nom: Array, polytope: Polytope, row: Row | Rows | None) -> Array | None:
        A, b, allowed = polytope.A, polytope.b, polytope.b + min(TOLERANCE, polytope.allowance)
        if row is not None:
            a, bound = np.atleast_2d(row.a), np.atleast_1d(row.bound)
            sizes = length(a)
            # Unit normals: rows of ‖a‖ from 1e-5 to 40 strain the tolerances. A row with a = 0 that
            # holds never binds.
            scale = np.where(sizes > 0.0, sizes, 1.0)
            bound = np.minimum(bound / scale, INFINITY)
            finite = (sizes < np.inf) & (bound > -INFINITY)
            if (bound[sizes == 0.0] < 0.0).any() or not finite.all():
                return None
            A, b = np.concatenate((A, a / scale[:, None])), np.concatenate((b, bound))
            allowed = np.concatenate((allowed, bound + TOLERANCE))
        if len(b) not in self._solvers:
            self._solvers[len(b)] = Solver(self._metric, len(b), self._most_steps)
        u = self._solvers[len(b)].solve(u_nom, A, b)
        return u if u is not None and (dot(A, u) <= allowed).all() else None


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
