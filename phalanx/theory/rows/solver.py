"""OSQP for a given number of rows."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Array
from phalanx.compat.osqp_without_scipy import compiled_part, without_scipy

Places = NDArray[np.integer[Any]]

_OSQP = compiled_part()
"""Loaded before the programs are forked: what is loaded later, each of them loads."""
INFINITY = 1e30
"""As OSQP reads it: a row of this bound binds nothing."""
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
    """One solver that is updated and asked again.

    Its sparsity is dense and fixed, since a zero that vanished from the pattern would make the
    update wrong. Adaptive ρ counts iterations, not time, and begins anew each time; nothing is
    scaled by what came before.
    """

    def __init__(self, metric: tuple[float, ...], rows: int, most_steps: int) -> None:
        """metric: w, one weight for each input. most_steps: it gives up after so many."""
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
    """A sparse matrix, column by column, as OSQP takes it."""

    shape: tuple[int, int]
    nnz: int
    indptr: Places
    """Where each column begins."""
    indices: Places
    """In which row each number stands."""
    data: Array


def _columns(values: Array, rows: Places, height: int) -> _Columns:
    """Equally many numbers in each column, and the rows in which they stand, one shape."""
    count, width = values.shape
    begins = np.arange(0, count * width + 1, count, dtype=np.int32)
    indices = rows.ravel(order="F").astype(np.int32)
    return _Columns((height, width), values.size, begins, indices, values.ravel(order="F"))
