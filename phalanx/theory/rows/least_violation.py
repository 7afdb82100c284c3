"""The input with the least worst violation of several rows: Eq. (LPnormal) for more than one.

A linear program in (u, s) with s the worst violation, solved at its vertices. least_violation.c
does so with the same bits, and runs where `phalanx compile` has built it.
"""

import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np

from phalanx.native.library import address, native_source, sample_states
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import EmptyPolytopeError, Polytope, basic_solutions
from phalanx.theory.rows.row import Rows

_MOST_COORDINATES = 7
"""D in least_violation.c: NumPy adds up to seven numbers from left to right."""
_LARGEST = 1e30
"""No result overflows with numbers up to it; with larger ones the reference runs."""


def least_vertex(A: Array, b: Array) -> list[float] | None:
    """The vertex of {x : A x <= b} that is least in its last coordinate, then in the others.

    None if float64 finds none.
    """
    try:
        solutions: list[list[float]] = basic_solutions(A, b).tolist()
    except EmptyPolytopeError:
        return None
    return min(solutions, key=lambda x: (x[-1], x))


def least_violation(
    polytope: Polytope,
    rows: Rows,
    vertex: Callable[[Array, Array], list[float] | None] = least_vertex,
) -> Array:
    """argmin over U_i of max_r (a_r u - bound_r), shape (m,); the least u if several are.

    At the vertices of U_i if float64 finds none of the program. Rows that stay below the least
    possible s for every u cannot bind, and are left out. If margins are unknown, with a bound of
    -inf, only those rows count, with a bound of 0.

    >>> from phalanx.theory.models.polytope import polytope
    >>> U = polytope(np.array([[1.0], [-1.0]]), np.ones(2))
    >>> least_violation(U, Rows(np.array([[1.0]]), np.array([-3.0])))
    array([-1.])
    """
    unknown = np.isneginf(rows.bound)
    if unknown.any():
        rows = Rows(rows.a[unknown], np.zeros(int(unknown.sum())))
    residuals = dot(rows.a[:, None], polytope.corners) - rows.bound[:, None]
    binding = residuals.max(axis=1) >= residuals.min(axis=1).max()
    # The least bound is shifted to zero, which changes s alone: large bounds would cost digits.
    a, bound = rows.a[binding], rows.bound[binding] - rows.bound[binding].min()
    s = np.repeat([-1.0, 0.0], [len(a), len(polytope.b)])
    A = np.concatenate([np.concatenate([a, polytope.A]), s[:, None]], axis=1)
    best = vertex(A, np.concatenate([bound, polytope.b]))
    if best is None:
        best = [*polytope.corners[int(np.argmin(residuals.max(axis=0)))], 0.0]
    # Whether a sum is -0.0 depends on NumPy's version; with 0.0 added it is not.
    return np.array(best[:-1]) + 0.0


class LeastVertex:
    """least_vertex; in C if the cache of compiled functions has it."""

    def __init__(self) -> None:
        self._compiled = compiled_vertex()

    def __call__(self, A: Array, b: Array) -> list[float] | None:
        """least_vertex of the same program."""
        if self._compiled is None or A.shape[1] > _MOST_COORDINATES:
            return least_vertex(A, b)
        table = np.concatenate([A, b[:, None]], axis=1)
        small = (np.abs(table) <= _LARGEST).all()
        return self._compiled(table) if small else least_vertex(A, b)


def compiled_vertex() -> "CompiledVertex | None":
    """Return the same in C; None if the cache of compiled functions lacks it."""
    return native_source(Path(__file__).with_suffix(".c").read_text("utf-8"), CompiledVertex)


class CompiledVertex:
    """The same in C."""

    def __init__(self, library: ctypes.PyDLL) -> None:
        """Raise ValueError unless the numbers are the reference's."""
        self.function = library.least_vertex
        for m, r in ((1, 3), (2, 4), (2, 9), (3, 6), (4, 9)):
            numbers = sample_states(r * (m + 1))[m].reshape(r, m + 1)
            table = np.concatenate([numbers, np.eye(m, m + 1), -np.eye(m, m + 1)])
            table = np.insert(table, m, np.repeat([-1.0, 0.0], [r, 2 * m]), axis=1)
            table[r:, -1] = 1.0
            if self(table) != least_vertex(table[:, :-1], table[:, -1]):
                raise ValueError("least_violation.c computes other bits")

    def __call__(self, table: Array) -> list[float] | None:
        count, d = len(table), table.shape[1] - 1
        vertex = np.empty(d)
        exists = self.function(d, count, address(table), address(vertex))
        return vertex.tolist() if exists else None
