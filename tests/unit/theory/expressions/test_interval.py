"""Interval extensions of expressions: bounds of every value over a box, or a refusal."""

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError

seeds = st.integers(0, 2**32 - 1)


def expressions(x: ca.SX) -> list[ca.SX]:
    return [
        x[0] * x[1] - x[0] / (2.0 + x[2] ** 2),
        ca.sin(x[0]) * ca.cos(3 * x[1]) + ca.exp(-x[2]),
        ca.sqrt(1 + ca.sumsqr(x)) * ca.fabs(x[1]),
        ca.fmax(x[0], x[1]) - ca.fmin(x[1], x[2]) + ca.sign(x[2]) * ca.fabs(x[2]) ** 3,
        ca.log(2.0 + ca.cos(x[0])) / (x[1] - 10.0),
        x[0] ** 3 - x[1] ** 4 + ca.fabs(x[2]) ** 1.5 + (x[2] - 20.0) ** -3,
        ca.if_else(x[0] > x[1], x[2], ca.if_else(x[1] <= 1.0, -x[2], ca.floor(x[0]))),
        ca.logic_or(x[0] < 0, ca.logic_not(ca.logic_and(x[1] < 1, x[2]))) * x[1],
        ca.atan2(x[1], x[0]) + ca.tanh(x[2]) * ca.ceil(x[1]) - ca.atan(x[0]),
        ca.tan(0.3 * x[0]) + (x[0] == x[1]) - (x[2] != 1.0) * ca.sinh(x[0]) + ca.asinh(x[1]),
    ]


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=25, deadline=None)
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


def test_the_extension_of_a_line_is_exact_and_division_by_what_may_be_zero_unbounded():
    x = ca.SX.sym("x")
    line, inverse = extend([2 - 3 * x, 1 / x], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert (float(line.lo), float(line.hi)) == (-4.0, 5.0)
    assert (float(inverse.lo), float(inverse.hi)) == (-np.inf, np.inf)


def test_zero_times_what_is_unbounded_is_unbounded_and_not_forgotten():
    """Ends that are symbols, as in a margin: CasADi must not simplify the question away."""
    x, y, ends = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("ends", 4)
    box = [Interval(ends[0], ends[1]), Interval(ends[2], ends[3])]
    (bound,) = extend([ca.fmax(x / y, -5)], [x, y], box)
    high = CompiledFunction([ends], [bound.hi])
    assert high(np.array([0.0, 0.0, -1.0, 2.0]))[0][0] == np.inf
    assert high(np.array([0.0, 3.0, -1.0, 2.0]))[0][0] == np.inf
    assert high(np.array([0.0, 3.0, 1.0, 2.0]))[0][0] == 3.0


@pytest.mark.parametrize("factor", [ca.exp, ca.sinh, lambda y: y, lambda y: 1 / (y - 1)])
def test_a_factor_without_bound_is_not_forgotten_wherever_it_comes_from(factor):
    x, y, ends = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("ends", 2)
    box = [Interval(ends[0], ends[0]), Interval(ca.SX(0), ends[1])]
    (bound,) = extend([ca.fmax(x * factor(y), -5)], [x, y], box)
    ends_of = CompiledFunction([ends], [ca.vertcat(*bound)])
    assert ends_of(np.array([0.0, math.inf]))[0].tolist() == [-math.inf, math.inf]
    assert ends_of(np.array([0.0, 0.5]))[0].tolist() == [0.0, 0.0]


def test_a_product_that_overflows_is_unbounded_and_not_forgotten():
    x, y, z, ends = *ca.vertsplit(ca.SX.sym("x", 3)), ca.SX.sym("ends", 3)
    box = [Interval(ends[0], ends[0]), Interval(ends[0], ends[0]), Interval(ends[1], ends[2])]
    (bound,) = extend([ca.fmax(-(z * (x * y)), -5)], [x, y, z], box)
    ends_of = CompiledFunction([ends], [ca.vertcat(*bound)])
    assert ends_of(np.array([2.0, 0.0, 1.0]))[0].tolist() == [-4.0, 0.0]
    assert ends_of(np.array([1e200, 0.0, 1.0]))[0].tolist() == [-math.inf, math.inf]


@pytest.mark.parametrize("function", [ca.sqrt, ca.log])
def test_outside_its_domain_a_function_is_unbounded_and_not_forgotten(function):
    x = ca.SX.sym("x")
    (bound,) = extend([ca.fabs(function(x))], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert float(bound.hi) == np.inf
    (bound,) = extend([ca.fmax(function(x), 0)], [x], [Interval(ca.SX(-1), ca.SX(2))])
    assert float(bound.hi) == np.inf


def test_an_operation_without_a_rule_is_refused_by_its_name():
    x = ca.SX.sym("x")
    with pytest.raises(UnboundedOperationError, match="no interval rule for the operation fmod"):
        extend([ca.fmod(x, 2.0)], [x], [Interval(ca.SX(0), ca.SX(1))])


JUMPS = {
    "a sign": lambda x: ca.sign(x - 0.5),
    "a comparison": lambda x: ca.if_else(x < 0.5, 1.0, 2.0),
    "a zone": lambda x: ca.logic_and(x > 0.5, x < 9.0) * 3.0,
    "a wall thinner than a comparison sees": lambda x: 1.0 * (x == 0.5),
    "a step": lambda x: ca.floor(x + 0.5),
    "a step up": lambda x: ca.ceil(x - 0.5),
    "the cut of a bearing": lambda x: ca.atan2(x - 0.5, -1.0),
    "a pole": lambda x: ca.atan(1.0 / (x - 0.5)),
    "a pole of a power": lambda x: ca.atan((x - 0.5) ** -3),
    "a tangent": lambda x: ca.atan(ca.tan(math.pi * x)),
    "a truth that is no comparison": lambda x: ca.if_else(x - 0.5, 1.0, 0.0),
}


@pytest.mark.parametrize("jumping", JUMPS.values(), ids=JUMPS)
def test_a_jump_is_seen_where_it_is_and_nowhere_else(jumping):
    """All of them have derivative zero, or none, where they do not jump."""
    x, ends = ca.SX.sym("x"), ca.SX.sym("ends", 2)
    box = [Interval(ends[0], ends[1])]
    is_continuous = CompiledFunction([ends], [continuous([jumping(x)], [x], box)])
    for low, high, expected in [(0.0, 0.4, 1), (0.4, 0.6, 0), (0.6, 0.9, 1), (0.3, 0.8, 0)]:
        assert is_continuous(np.array([low, high]))[0][0] == expected


def test_what_leaves_its_domain_is_not_continuous():
    x = ca.SX.sym("x")
    for expression in (ca.sqrt(x), ca.log(x), x**1.5):
        for low, expected in ((-0.1, 0.0), (0.1, 1.0)):
            box = [Interval(ca.SX(low), ca.SX(1.0))]
            assert float(continuous([expression], [x], box)) == expected


def test_a_kink_is_no_jump_but_its_derivative_is():
    x = ca.SX.sym("x")
    box = [Interval(ca.SX(-1), ca.SX(1))]
    for kink in (ca.fabs(x), ca.fmax(x, 0.0), ca.fmin(x, 2 * x)):
        assert float(continuous([kink], [x], box)) == 1.0
        assert float(continuous([ca.jacobian(kink, x)], [x], box)) == 0.0
