"""Ends that are rounded outwards hold every true value, whatever the operation and the box."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
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


@pytest.mark.nightly
@operations
@given(a=boxes, b=boxes, share=st.floats(0, 1))
@settings(max_examples=300, deadline=None)
def test_of_many_boxes_no_true_value_is_beyond_an_end(name, a, b, share):
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
