"""Ends that are rounded outwards hold every true value, whatever the operation and the box."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import added, dot, length, solve
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError
from phalanx.theory.expressions.rounding import outwards
from tests.unit.theory.true_values import OPERATIONS, boxes, is_held, true_value, within

REFUSED = {"asin", "acos", "cosh"}


@cache
def bounds(name: str) -> CompiledFunction:
    """The lower and the upper end, of each argument's."""
    operation = OPERATIONS[name]
    x, given_ends = (ca.SX.sym(s, n * operation.arguments) for s, n in (("x", 1), ("e", 2)))
    box = [Interval(*pair) for pair in zip(*[iter(ca.vertsplit(given_ends))] * 2, strict=True)]
    with outwards():
        (bound,) = extend([operation.build(*ca.vertsplit(x))], ca.vertsplit(x), box)
    return CompiledFunction([given_ends], [ca.vertcat(*bound)])


operations = pytest.mark.parametrize("name", [name for name in OPERATIONS if name not in REFUSED])


@pytest.mark.slow
@operations
@given(a=boxes, b=boxes, share=st.floats(0, 1))
@settings(max_examples=50, deadline=None)
def test_no_true_value_is_beyond_an_end(name, a, b, share):
    holds_all_true_values(name, a, b, share)


def holds_all_true_values(name, a, b, share):
    operation = OPERATIONS[name]
    sides = (a, b)[: operation.arguments]
    low, high = bounds(name)(np.array(sides).ravel())[0]
    others = within(b, share) if operation.arguments == 2 else [None]
    for x in within(a, share):
        for y in others:
            truth = true_value(operation, x, y)
            # What is not a number is not known: no comparison takes it for proven.
            assert np.isnan(low) or np.isnan(high) or is_held(low, truth, high), (x, y)


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_what_has_no_rule_is_refused(name):
    x = ca.SX.sym("x")
    with pytest.raises(UnboundedOperationError, match=name):
        extend([OPERATIONS[name].build(x)], [x], [Interval(x, x)])


def test_the_sine_of_nought_may_be_nought():
    """So that nothing is made of its sign."""
    x, zero = ca.SX.sym("x"), Interval(ca.SX(0.0), ca.SX(0.0))
    with outwards():
        (bound,) = extend([ca.if_else(ca.sin(x) > 0, -1.0, 835.0)], [x], [zero])
        assert float(continuous([ca.sin(x) > 0], [x], [zero])) == 0.0
    assert float(bound.hi) >= 835.0


def test_ends_are_rounded_to_nearest_elsewhere():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    box = [Interval(ca.SX(0.1), ca.SX(0.1)), Interval(ca.SX(0.2), ca.SX(0.2))]
    (bound,) = extend([x + y], [x, y], box)
    assert float(bound.lo) == float(bound.hi) == 0.1 + 0.2
    with outwards():
        (bound,) = extend([x + y], [x, y], box)
    assert float(bound.lo) < 0.1 + 0.2 < float(bound.hi)
    assert float(bound.hi) - float(bound.lo) < 3e-16


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
