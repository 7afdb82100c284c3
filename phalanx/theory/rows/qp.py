"""The quadratic program of one agent: min ‖u - u_nom‖² in U_i and the safety rows."""

import numpy as np
import osqp
from numpy.typing import NDArray
from scipy import sparse

from phalanx.theory.expressions.exact import dot, length
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.row import Row, Rows

Array = NDArray[np.float64]

TOLERANCE = 1e-6
"""How far a solution may stand outside its constraints, each scaled to a unit normal."""

# OSQP reads 1e30 as infinity: a row that binds nothing.
_INFINITY = 1e30
_RHO = 0.1
_STEEPEST = 1e4
"""Objectives with a larger linear part are scaled down to it."""
_SOLVED = int(osqp.SolverStatus.OSQP_SOLVED)


class NearestInput:
    """argmin of Σ w (u - u_nom)² over A u <= b and a u <= bound, by OSQP.

    One solver is kept and updated: its sparsity is dense and fixed, since a zero that vanished
    from the pattern would make the update wrong. An answer depends on its question alone: adaptive
    ρ counts iterations, not time, and begins anew each time; nothing is scaled by what came before.
    """

    def __init__(self, metric: tuple[float, ...], rows: int, safety_rows: int = 1) -> None:
        """For inputs of len(metric) components, a polytope of `rows` rows and the safety rows."""
        m, total = len(metric), rows + safety_rows
        self._weights = np.array(metric)
        self._polytope, self._safety = slice(rows), slice(rows, total)
        self._upper = np.zeros(total)
        self._matrix = np.zeros((total, m))
        self._allowed = np.full(total, TOLERANCE)
        solver = osqp.OSQP()
        pattern = sparse.csc_matrix(np.ones((total, m)))
        solver.setup(
            P=sparse.csc_matrix(np.diag(2.0 * self._weights)),
            q=np.zeros(m),
            A=pattern,
            l=np.full(total, -np.inf),
            u=np.ones(total),
            verbose=False,
            eps_abs=1e-6,
            eps_rel=1e-8,
            polishing=True,
            max_iter=20_000,
            check_termination=10,
            adaptive_rho=True,
            adaptive_rho_interval=50,
            warm_starting=False,
            rho=_RHO,
            scaling=0,
        )
        # The compiled solver itself: what its wrapper adds to every call takes as long as a solve.
        self._osqp = solver._solver

    def solve(
        self, u_nom: Array, polytope: Polytope, row: Row | Rows | None = None
    ) -> Array | None:
        """The nearest input, shape (m,), or None unless OSQP solved it and every row holds.

        In a box the nearest input without the rows is u_nom clipped, since the metric is diagonal;
        if that satisfies the rows, it is the answer, and OSQP is not asked.

        Args:
            u_nom: shape (m,).
            polytope: U_i.
            row: the safety row or rows; None asks for the projection onto U_i.
        """
        if polytope.box is not None:
            clipped = np.minimum(np.maximum(u_nom, polytope.box.low), polytope.box.high)
            if row is None or (dot(row.a, clipped) <= row.bound).all():
                return clipped
        self._matrix[self._polytope], self._upper[self._polytope] = polytope.A, polytope.b
        self._matrix[self._safety], self._upper[self._safety] = 0.0, _INFINITY
        if row is not None:
            a, bound = np.atleast_2d(row.a), np.atleast_1d(row.bound)
            sizes = length(a)
            if (bound[sizes == 0.0] < 0.0).any() or np.isneginf(bound).any():
                return None
            # Unit normals: rows of ‖a‖ from 1e-5 to 40 would strain the tolerances. A row that
            # no input changes, and that holds, binds nothing.
            scale = np.where(sizes > 0.0, sizes, 1.0)
            self._matrix[self._safety] = a / scale[:, None]
            self._upper[self._safety] = np.minimum(bound / scale, _INFINITY)
        self._allowed[self._polytope] = min(TOLERANCE, polytope.allowance)
        # Scaling the objective leaves the argmin where it is; OSQP gives up on slopes of 10⁶.
        steepest = 2.0 * float(np.abs(self._weights * u_nom).max())
        quadratic = 2.0 * self._weights * (_STEEPEST / max(steepest, _STEEPEST))
        self._osqp.update_rho(_RHO)
        self._osqp.update_data_vec(q=-quadratic * u_nom, l=None, u=self._upper)
        dense = self._matrix.ravel(order="F")
        self._osqp.update_data_mat(P_x=quadratic, P_i=None, A_x=dense, A_i=None)
        self._osqp.solve()
        if self._osqp.info.status_val != _SOLVED:
            return None
        u: Array = np.array(self._osqp.solution.x)
        return u if (dot(self._matrix, u) <= self._upper + self._allowed).all() else None
