"""Interval extensions of expressions: bounds of every value over a box, or a refusal."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, extend

seeds = st.integers(0, 2**32 - 1)


def expressions(x: ca.SX) -> list[ca.SX]:
    return [
        x[0] * x[1] - x[0] / (2.0 + x[2] ** 2),
        ca.sin(x[0]) * ca.cos(3 * x[1]) + ca.exp(-x[2]),
        ca.sqrt(1 + ca.sumsqr(x)) * ca.fabs(x[1]),
        ca.fmax(x[0], x[1]) - ca.fmin(x[1], x[2]) + ca.sign(x[2]) * ca.fabs(x[2]) ** 3,
        ca.log(2.0 + ca.cos(x[0])) / (x[1] - 10.0),
        x[0] ** 3 - x[1] ** 4 + ca.fabs(x[2]) ** 1.5 + (x[2] - 20.0) ** -3,
    ]


@given(seed=seeds)
@settings(max_examples=50, deadline=None)
def test_an_interval_extension_holds_every_value_over_the_box(seed):
    rng = np.random.default_rng(seed)
    x = ca.SX.sym("x", 3)
    low = rng.uniform(-4, 4, 3)
    high = low + rng.exponential(1.0, 3)
    box = [Interval(ca.SX(a), ca.SX(b)) for a, b in zip(low, high, strict=True)]
    bounds = extend(expressions(x), ca.vertsplit(x), box)
    lows, highs = (np.array(ca.DM(ca.vertcat(*side))).ravel() for side in zip(*bounds, strict=True))
    values = CompiledFunction([x], [ca.vertcat(*expressions(x))])
    for _ in range(50):
        value = values(rng.uniform(low, high))[0]
        assert (lows <= value + 1e-12 * (1 + abs(value))).all()
        assert (value <= highs + 1e-12 * (1 + abs(value))).all()


def test_the_extension_of_a_line_is_exact():
    x = ca.SX.sym("x")
    (bound,) = extend([2 - 3 * x], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert (float(bound.lo), float(bound.hi)) == (-4.0, 5.0)


def test_division_by_what_may_be_zero_is_unbounded():
    x = ca.SX.sym("x")
    (bound,) = extend([1 / x], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert (float(bound.lo), float(bound.hi)) == (-np.inf, np.inf)


def test_zero_times_what_is_unbounded_is_unbounded_and_not_forgotten():
    """Ends that are symbols, as in a margin: CasADi must not simplify the question away."""
    x, y, ends = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("ends", 4)
    box = [Interval(ends[0], ends[1]), Interval(ends[2], ends[3])]
    (bound,) = extend([ca.fmax(x / y, -5)], [x, y], box)
    high = CompiledFunction([ends], [bound.hi])
    assert high(np.array([0.0, 0.0, -1.0, 2.0]))[0][0] == np.inf
    assert high(np.array([0.0, 3.0, -1.0, 2.0]))[0][0] == np.inf
    assert high(np.array([0.0, 3.0, 1.0, 2.0]))[0][0] == 3.0


@pytest.mark.parametrize("function", [ca.sqrt, ca.log])
def test_outside_its_domain_a_function_is_unbounded_and_not_forgotten(function):
    x = ca.SX.sym("x")
    (bound,) = extend([ca.fabs(function(x))], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert float(bound.hi) == np.inf
    (bound,) = extend([ca.fmax(function(x), 0)], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert float(bound.hi) == np.inf


def test_an_operation_without_a_rule_is_refused():
    x = ca.SX.sym("x")
    with pytest.raises(UnboundedOperationError, match="no interval rule"):
        extend([ca.atan2(x, 2.0)], [x], [Interval(ca.SX(0), ca.SX(1))])
