"""Input polytopes U(x) = {u : A(x) u <= b(x)} and their linear programs, Eqs. (vLPs), (LPvminmax).

A linear function on a compact polytope attains its extremes at vertices, and these polytopes are
small (m <= 3), so the programs are solved exactly by looking at every vertex.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length, solve

_PARALLEL = 1e-12
_SLACK = 1e-9

ACTUATION = 1e-5
"""Allowed distance of an applied input from U, since solvers are not exact."""


class EmptyPolytopeError(ValueError):
    """Assumption (Ui) fails: {u : A u <= b} has no vertex, so it is empty or unbounded."""


@dataclass(frozen=True, eq=False)
class Box:
    """{u : low <= u <= high}, shapes (m,)."""

    low: Array
    high: Array

    @cached_property
    def ends(self) -> tuple[list[float], list[float]]:
        """low and high as lists: for so few numbers they are faster than arrays."""
        return self.low.tolist(), self.high.tolist()

    def nearest(self, u: Array) -> Array:
        """Return u with each number within its bounds, shape (m,)."""
        within: Array = np.minimum(np.maximum(u, self.low), self.high)
        return within

    def holds(self, u: Array | Sequence[float]) -> bool:
        """Return whether low <= u <= high."""
        for low, number, high in zip(self.ends[0], u, self.ends[1], strict=True):
            if not low <= number <= high:
                return False
        return True


class Polytope(NamedTuple):
    """U(x) = {u : A u <= b} at one state.

    >>> from phalanx.theory.models.polytope import polytope
    >>> polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4)).takes([1.0, 0.5])
    True
    """

    A: Array
    """shape (r, m)"""
    b: Array
    """shape (r,)"""
    corners: Array
    """Its vertices, shape (v, m)."""
    box: Box | None
    """The same set as bounds on each input, if it is a box."""
    allowance: float
    """Excess of A u over b for which u is still within ACTUATION of the polytope."""

    def takes(self, u: Array | Sequence[float]) -> bool:
        """Return whether u, shape (m,), is within ACTUATION of the polytope."""
        if self.box is not None and self.box.holds(u):
            return True
        return bool((dot(self.A, np.asarray(u)) <= self.b + self.allowance).all())


def polytope(A: Array, b: Array) -> Polytope:
    """{u : A u <= b} with its vertices; shapes (r, m), (r,). Raises EmptyPolytopeError.

    Rows are scaled to unit normals, for which the tolerances are meant.
    """
    sizes = length(A)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    A, b = A / sizes[:, None], b / sizes
    corners = vertices(A, b)
    _require_bounded(A)
    aligned = (np.count_nonzero(A, axis=1) == 1).all()
    box = Box(corners.min(axis=0), corners.max(axis=0)) if aligned else None
    return Polytope(A, b, corners, box, _allowance(A, b, corners))


def _allowance(A: Array, b: Array, corners: Array) -> float:
    """An s for which {u : A u <= b + s}, unit normals, lies within ACTUATION of the corners' hull.

    The distance from a convex set is largest at a vertex. At a sharp corner that is much farther
    out than s, so distances are measured along edges, from corner to corner.
    """
    allowance = ACTUATION
    while (farthest := _farthest(vertices(A, b + allowance), corners)) > ACTUATION:
        allowance *= 0.99 * ACTUATION / farthest
    return allowance


def _farthest(points: Array, corners: Array) -> float:
    """The largest distance of a point from its nearest corner."""
    with np.errstate(over="ignore"):  # a distance whose square overflows is not the least
        return float(length(points[:, None] - corners).min(axis=1).max())


def vertices(A: Array, b: Array) -> Array:
    """Vertices of {u : A u <= b}, shape (v, m), in ascending order; as basic_solutions else."""
    corners: Array = np.unique(basic_solutions(A, b), axis=0)
    return corners


def basic_solutions(A: Array, b: Array) -> Array:
    """The feasible basic solutions of A u <= b, shape (k, m), in the order of their rows.

    They are its vertices: those where more than m rows meet are there several times.

    Args:
        A: shape (r, m). b: shape (r,).

    Raises:
        EmptyPolytopeError: there is no vertex.
    """
    m = A.shape[1]
    if len(b) < m:
        raise EmptyPolytopeError(f"no vertex in {{u : A u <= b}} with {len(b)} rows in R^{m}")
    candidates = np.array(list(combinations(range(len(b)), m)))
    systems = A[candidates]
    scale = np.prod(length(systems), axis=1)
    points, determinants = solve(systems, b[candidates])
    regular = np.abs(determinants) > _PARALLEL * np.maximum(scale, 1e-300)
    if not regular.any():
        raise EmptyPolytopeError(f"no vertex in {{u : A u <= b}} with {len(b)} rows in R^{m}")
    points = points[regular]
    tolerance = _SLACK * (1.0 + np.abs(b))
    inside = (dot(points[:, None], A) <= b + tolerance).all(axis=1)
    if not inside.any():
        raise EmptyPolytopeError(f"no point satisfies all {len(b)} rows of A u <= b")
    feasible: Array = points[inside]
    return feasible


def _require_bounded(A: Array) -> None:
    """Raise EmptyPolytopeError if A u <= 0 has a solution other than zero: then U is unbounded."""
    rows, m = A.shape
    within_box = np.vstack([A, np.eye(m), -np.eye(m)])
    directions = vertices(within_box, np.concatenate([np.zeros(rows), np.ones(2 * m)]))
    if np.abs(directions).max() > 10 * _SLACK:
        raise EmptyPolytopeError(f"{{u : A u <= b}} with {rows} rows in R^{m} is unbounded")


def extremes(c: Array, corners: Array) -> tuple[float, float]:
    """min and max of cᵀu over the polytope with these vertices, Eq. (LPvminmax)."""
    values = dot(corners, c)
    return float(values.min()), float(values.max())


def minimiser(c: Array, corners: Array) -> Array:
    """u^min = argmin cᵀu, shape (m,), Eq. (umin); the first vertex if several are equal."""
    point: Array = corners[int(np.argmin(dot(corners, c)))]
    return point


def maximiser(c: Array, corners: Array) -> Array:
    """u^max = argmax cᵀu, shape (m,), Eq. (umax); the first vertex if several are equal."""
    return minimiser(-c, corners)


def constant_polytope(A: ca.SX, b: ca.SX) -> Polytope | None:
    """The polytope as numbers if it does not depend on the state. Raises EmptyPolytopeError."""
    A, b = ca.SX(A), ca.SX(b)  # a user's may be arrays
    if not (A.is_constant() and b.is_constant()):
        return None
    faces = np.array(ca.DM(A))
    return _polytope_of(faces.shape, faces.tobytes(), np.array(ca.DM(b)).tobytes())


@cache
def _polytope_of(shape: tuple[int, ...], A: bytes, b: bytes) -> Polytope:
    """The polytope with these bits, cached and read-only; by bits since 0.0 equals -0.0."""
    constant = polytope(np.frombuffer(A).reshape(shape), np.frombuffer(b))
    sides = (constant.box.low, constant.box.high) if constant.box else ()
    for array in (constant.A, constant.b, constant.corners, *sides):
        array.flags.writeable = False
    return constant
