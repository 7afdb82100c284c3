"""The checker's intervals hold every true value."""

from collections.abc import Callable
from functools import cache, partial

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phalanx_certify.checker.interval_function import IntervalFunction
from phalanx_certify.checker.intervals import Interval, UncertifiableError, norm, point

from tests.unit.theory.true_values import OPERATIONS, boxes, is_held, true_value, within

Box = list[tuple[float, float]]
Bounds = tuple[float, float, bool]


def bounds(expression: ca.SX, x: ca.SX, box: Box) -> Bounds:
    """Bound a scalar expression over one box."""
    return over(IntervalFunction([x], [expression]), box)


def over(function: IntervalFunction, box: Box) -> Bounds:
    low, high = (np.array(side)[:, None] for side in zip(*box, strict=True))
    (result,), smooth = function(Interval(low, high))
    return float(result.lo[0, 0]), float(result.hi[0, 0]), bool(smooth[0])


@cache
def compiled(name: str) -> Callable[[Box], Bounds]:
    """One of OPERATIONS."""
    x = ca.SX.sym("x", OPERATIONS[name].arguments)
    function = IntervalFunction([x], [OPERATIONS[name].build(*ca.vertsplit(x))])
    return partial(over, function)


operations = pytest.mark.parametrize("name", [name for name in OPERATIONS if name != "asinh"])


@pytest.mark.slow
@operations
@given(a=boxes, b=boxes, share=st.floats(0, 1))
@settings(max_examples=50, deadline=None)
def test_no_true_value_is_beyond_an_end(name, a, b, share):
    holds_all_true_values(name, a, b, share)


def holds_all_true_values(name, a, b, share):
    operation = OPERATIONS[name]
    sides = [a, b][: operation.arguments]
    low, high, _ = compiled(name)(sides)
    others = within(b, share) if operation.arguments == 2 else [None]
    for x in within(a, share):
        for y in others:
            assert is_held(low, true_value(operation, x, y), high), (x, y)


def test_a_wave_and_an_even_power_reach_their_extremes_inside_a_box():
    x = ca.SX.sym("x")
    # CasADi multiplies up to the power 100.
    assert bounds(x**104, x, [(-1.0, 0.5)])[:2] == pytest.approx((0.0, 1.0))
    assert bounds(x**101, x, [(-1.0, 0.5)])[:2] == pytest.approx((-1.0, 0.0))
    assert bounds(ca.sin(x), x, [(1.0, 2.0)])[1] == 1.0
    assert bounds(ca.sin(x), x, [(4.0, 5.0)])[0] == -1.0
    assert bounds(ca.cos(x), x, [(-1e9, 1e9)])[:2] == (-1.0, 1.0)
    low, high, _ = bounds(ca.cos(x), x, [(0.5, 1.0)])
    assert np.cos(1.0) - 1e-14 < low < high < np.cos(0.5) + 1e-14


@pytest.mark.parametrize(
    ("expression", "box"),
    [
        (lambda x: 1 / x, (-1.0, 1.0)),
        (lambda x: ca.log(x), (-1.0, 1.0)),
        (lambda x: ca.sqrt(x), (-1e-9, 1.0)),
        (lambda x: ca.tan(x), (1.5, 1.6)),
        (lambda x: ca.asin(x), (0.5, 1.5)),
        (lambda x: x**0.5, (-1.0, 1.0)),
        (lambda x: ca.exp(x) - ca.exp(x + 1), (700.0, 800.0)),
    ],
)
def test_what_is_not_known_is_everything(expression, box):
    x = ca.SX.sym("x")
    assert bounds(expression(x), x, [box])[:2] == (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("expression", "smooth", "jumping"),
    [
        (ca.sign, (0.1, 0.2), (0.0, 0.2)),
        (ca.floor, (1.1, 1.9), (1.0, 1.5)),
        (ca.ceil, (1.1, 1.9), (1.5, 2.0)),
        (lambda x: x < 1, (1.1, 2.0), (0.5, 1.0)),
        (lambda x: x <= 1, (0.1, 0.2), (1.0, 2.0)),
        (lambda x: x == 1, (1.1, 2.0), (0.5, 1.0)),
        (lambda x: x != 1, (1.1, 2.0), (1.0, 1.0)),
        (lambda x: x != 1, (0.1, 0.9), (0.5, 1.5)),
        (lambda x: ca.if_else(x > 1, x, -x), (1.1, 2.0), (0.5, 1.5)),
        (lambda x: ca.logic_and(x > 1, x < 2), (1.1, 1.9), (1.5, 2.5)),
        (lambda x: ca.atan2(x, -1.0), (0.1, 0.2), (-0.1, 0.1)),
        (lambda x: ca.jacobian(ca.fabs(x), x), (0.1, 0.2), (-0.1, 0.1)),
        (lambda x: ca.jacobian(ca.fmax(x, 1.0), x), (1.1, 1.2), (0.9, 1.2)),
        (lambda x: ca.jacobian(ca.fmin(x, 1.0), x), (1.1, 1.2), (0.9, 1.2)),
    ],
)
def test_a_jump_is_seen_wherever_it_lies_in_a_box(expression, smooth, jumping):
    x = ca.SX.sym("x")
    assert bounds(expression(x), x, [smooth])[2]
    assert not bounds(expression(x), x, [jumping])[2]


def test_where_a_condition_is_not_known_either_value_is_held():
    x = ca.SX.sym("x")
    low, high, _ = bounds(ca.if_else(x > 0.0, -0.5, 0.0), x, [(-1.0, 1.0)])
    assert low <= -0.5
    assert high >= 0.0


def test_an_operation_without_a_rule_is_refused_by_name():
    x = ca.SX.sym("x")
    with pytest.raises(UncertifiableError, match="'erf'"):
        IntervalFunction([x], [ca.erf(x)])


def test_the_norm_of_nothing_is_nothing():
    assert norm(point(np.zeros((3, 1)))).hi[0] < 1e-150
