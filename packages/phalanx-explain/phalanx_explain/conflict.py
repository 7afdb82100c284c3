"""The least set of rows that exclude one another: no input of U_i keeps all of them.

By Helly's theorem it has at most m + 1 rows for m inputs, so that few sets need to be tried.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows


def least_conflict(polytope: Polytope, rows: Rows) -> tuple[int, ...]:
    """Return the fewest rows that no input keeps together, the first of equally many.

    Empty if some input keeps all rows.
    """
    inputs = rows.a.shape[1]
    solver = NearestInput((1.0,) * inputs)

    def excluded(chosen: Sequence[int]) -> bool:
        some = Rows(rows.a[list(chosen)], rows.bound[list(chosen)])
        return solver.solve(np.zeros(inputs), polytope, some) is None

    # A row that holds at every corner of U_i excludes nothing.
    holds = (dot(rows.a[:, None], polytope.corners) <= rows.bound[:, None]).all(axis=1)
    candidates = np.flatnonzero(~holds).tolist()
    if not candidates or not excluded(candidates):
        return ()
    sizes = range(1, min(inputs + 1, len(candidates)) + 1)
    return next(
        (s for k in sizes for s in combinations(candidates, k) if excluded(s)), tuple(candidates)
    )


def given_up(polytope: Polytope, rows: Rows, conflict: Sequence[int]) -> Array:
    """Return by how much each row of a conflict is violated where the worst is least.

    Shape (k,), in the unit of the rows.
    """
    some = Rows(rows.a[list(conflict)], rows.bound[list(conflict)])
    u = NearestInput((1.0,) * rows.a.shape[1]).least_violation(polytope, some)
    violation: Array = dot(some.a, u) - some.bound
    return violation
