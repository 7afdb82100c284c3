"""Products, lengths and small systems against numpy's; sums against their definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.expressions.exact import added, dot, length, solve

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, rows=st.integers(1, 20), columns=st.integers(1, 12))
def test_products_are_those_of_linear_algebra(seed, rows, columns):
    rng = np.random.default_rng(seed)
    A, B, x = (
        rng.normal(size=(rows, columns)),
        rng.normal(size=(5, columns)),
        rng.normal(size=columns),
    )
    assert dot(A, x) == pytest.approx(A @ x, abs=1e-13)
    assert dot(A[:, None], B) == pytest.approx(A @ B.T, abs=1e-13)
    assert length(A) == pytest.approx(np.linalg.norm(A, axis=1), rel=1e-14)


@given(seed=seeds)
def test_short_products_are_added_from_left_to_right(seed):
    a, b = np.random.default_rng(seed).normal(size=(2, 3)).tolist()
    by_hand = a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    assert float(dot(np.array(a), np.array(b))) == by_hand


def test_sums_round_at_each_step():
    # Builtin sum() gives 2.0 from Python 3.12 on.
    assert added([1.0, 1e100, 1.0, -1e100]) == 0.0
    assert added(iter([])) == 0.0


@given(seed=seeds, m=st.integers(1, 4), k=st.integers(1, 6))
def test_systems_are_solved_and_their_determinants_found(seed, m, k):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(k, m, m)) * 10.0 ** rng.uniform(-3, 3), rng.normal(size=(k, m))
    x, determinants = solve(A, b)
    assert determinants == pytest.approx(np.linalg.det(A), rel=1e-9)
    for system, right, answer in zip(A, b, x, strict=True):
        error = np.abs(system @ answer - right).max()
        assert error <= 1e-12 * np.linalg.cond(system) * np.abs(right).max()


def test_a_system_that_needs_a_pivot_is_solved_and_a_singular_one_has_no_determinant():
    A = np.array([[[0.0, 2.0], [4.0, 0.0]], [[1.0, 2.0], [2.0, 4.0]]])
    x, determinants = solve(A, np.array([[2.0, 4.0], [1.0, 1.0]]))
    assert x[0].tolist() == [1.0, 1.0]
    assert determinants.tolist() == [-8.0, 0.0]
