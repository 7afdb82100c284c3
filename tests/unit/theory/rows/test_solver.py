"""OSQP by its compiled part alone: what its Python package says, to the last bit."""

import sys

import numpy as np
import osqp
import pytest
from scipy import sparse

from phalanx.theory.rows.qp import Solver


def by_the_package(w: np.ndarray, u_nom: np.ndarray, A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The same problem, as OSQP's documentation has it put."""
    solver = osqp.OSQP(algebra="builtin")
    solver.setup(
        P=sparse.csc_matrix(np.diag(2.0 * w)),
        q=-2.0 * w * u_nom,
        A=sparse.csc_matrix(A),
        l=np.full(len(b), -np.inf),
        u=b,
        verbose=False,
        eps_abs=1e-6,
        eps_rel=1e-8,
        polishing=True,
        check_termination=10,
        max_iter=20_000,
        adaptive_rho=True,
        adaptive_rho_interval=50,
        warm_starting=False,
        rho=0.1,
        scaling=0,
    )
    solved = solver.solve(raise_error=True)
    return np.array(solved.x)


@pytest.mark.parametrize("inputs", [1, 2, 3])
def test_the_compiled_part_says_what_the_package_says(inputs: int) -> None:
    rng = np.random.default_rng(inputs)
    for rows in (2, 4, 9):
        w, A = rng.uniform(0.5, 2.0, inputs), rng.normal(size=(rows, inputs))
        b, u_nom = rng.uniform(0.1, 1.0, rows), rng.normal(scale=3.0, size=inputs)
        ours = Solver(tuple(w), rows, 20_000).solve(u_nom, A, b)
        assert ours is not None
        assert ours.tobytes() == by_the_package(w, u_nom, A, b).tobytes()


def test_there_is_one_compiled_part_whoever_imports_it() -> None:
    assert osqp.OSQP(algebra="builtin").ext is sys.modules["osqp.ext_builtin"]
