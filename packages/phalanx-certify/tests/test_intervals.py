"""The checker's intervals hold every true value, exactly or to 60 digits."""

from collections.abc import Callable
from decimal import Decimal, localcontext
from fractions import Fraction
from functools import cache, partial
from math import prod

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phalanx_certify.checker.interval_function import IntervalFunction
from phalanx_certify.checker.intervals import Interval, UncertifiableError, norm, point

from tests.unit.theory.true_values import OPERATIONS, boxes, is_held, true_value, within

numbers = st.floats(-50.0, 50.0) | st.sampled_from([0.0, 1.0, -1.0, 1e-300, 3e154, -1e200])
shares = st.fractions(0, 1)


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


def holds(low: float, exact: Fraction | Decimal, high: float) -> bool:
    kind = type(exact)
    return (low == -np.inf or kind(low) <= exact) and (high == np.inf or exact <= kind(high))


RATIONAL: list[tuple[Callable[..., ca.SX], Callable[..., Fraction]]] = [
    (lambda a, b: a + b, lambda a, b: a + b),
    (lambda a, b: a - b, lambda a, b: a - b),
    (lambda a, b: a * b, lambda a, b: a * b),
    (lambda a, b: a / b, lambda a, b: a / b),
    (lambda a, b: a * a - b**2, lambda a, b: a**2 - b**2),
    (lambda a, b: 1 / b + 2 * a, lambda a, b: 1 / b + 2 * a),
    (lambda a, b: a**3 + b**4, lambda a, b: a**3 + b**4),
    (lambda a, b: b**-2 - a, lambda a, b: 1 / b**2 - a),
    (lambda a, b: ca.fabs(a) - ca.fmin(a, b), lambda a, b: abs(a) - min(a, b)),
    (lambda a, b: ca.fmax(a, -b) * a, lambda a, b: max(a, -b) * a),
    (lambda a, b: (a - b) * (a + b) * 0.1, lambda a, b: (a**2 - b**2) * Fraction(0.1)),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", range(len(RATIONAL)))
@given(ends=st.tuples(numbers, numbers, numbers, numbers), s=shares, t=shares)
@settings(max_examples=25, deadline=None)
def test_arithmetic_holds_the_exact_result(case, ends, s, t):
    build, exactly = RATIONAL[case]
    box = [tuple(sorted(ends[:2])), tuple(sorted(ends[2:]))]
    x = ca.SX.sym("x", 2)
    low, high, _ = bounds(build(x[0], x[1]), x, box)
    a, b = (
        Fraction(lo) + share * (Fraction(hi) - Fraction(lo))
        for (lo, hi), share in zip(box, (s, t), strict=True)
    )
    if b != 0:
        assert holds(low, exactly(a, b), high)
    assert low <= high


def series(terms: Callable[[int], tuple[int, int]]) -> Callable[[Decimal], Decimal]:
    """Σ sign x^n / n! with (sign, n) = terms(k), which converges for every x."""

    def value(x: Decimal) -> Decimal:
        return sum(
            (
                sign * (x**n if n else 1) / Decimal(prod(range(1, n + 1)))
                for sign, n in map(terms, range(140))
            ),
            Decimal(0),
        )

    return value


sine = series(lambda k: ((-1) ** k, 2 * k + 1))
cosine = series(lambda k: ((-1) ** k, 2 * k))
hyperbolic_sine = series(lambda k: (1, 2 * k + 1))
hyperbolic_cosine = series(lambda k: (1, 2 * k))
REAL: list[tuple[Callable[[ca.SX], ca.SX], Callable[[Decimal], Decimal]]] = [
    (ca.sin, sine),
    (ca.cos, cosine),
    (ca.tan, lambda x: sine(x) / cosine(x)),
    (ca.exp, lambda x: x.exp()),
    (lambda x: ca.log(ca.fabs(x) + 0.25), lambda x: (abs(x) + Decimal("0.25")).ln()),
    (lambda x: ca.sqrt(ca.fabs(x)), lambda x: abs(x).sqrt()),
    (ca.sinh, hyperbolic_sine),
    (ca.cosh, hyperbolic_cosine),
    (ca.tanh, lambda x: hyperbolic_sine(x) / hyperbolic_cosine(x)),
    (
        lambda x: (x * x + 0.5) ** 1.75,
        lambda x: (Decimal("1.75") * (x * x + Decimal("0.5")).ln()).exp(),
    ),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", range(len(REAL)))
@given(a=st.floats(-20, 20), width=st.just(0.0) | st.floats(1e-12, 8.0), share=st.floats(0, 1))
@settings(max_examples=20, deadline=None)
def test_library_functions_hold_the_true_value(case, a, width, share):
    build, truly = REAL[case]
    x = ca.SX.sym("x")
    low, high, smooth = bounds(build(x), x, [(a, a + width)])
    with localcontext() as context:
        context.prec = 60
        at = min(Decimal(a) + Decimal(share) * Decimal(width), Decimal(a + width))
        assert holds(low, truly(at), high)
    assert smooth


@pytest.mark.parametrize(
    ("function", "inverse", "least", "most"),
    [
        (ca.asin, sine, -1.0, 1.0),
        (ca.atan, lambda y: sine(y) / cosine(y), -30.0, 30.0),
        (lambda x: -ca.acos(x), lambda y: cosine(y), -1.0, 1.0),
        (lambda x: ca.atan2(x, 1.0), lambda y: sine(y) / cosine(y), -30.0, 30.0),
    ],
)
@given(s=st.floats(0, 1), t=st.floats(0, 1))
@settings(max_examples=20, deadline=None)
def test_inverse_functions_hold_the_true_value(function, inverse, least, most, s, t):
    """They increase, so their bounds may be judged by what they are the inverse of."""
    ends = sorted(least + share * (most - least) for share in (s, t))
    x = ca.SX.sym("x")
    low, high, _ = bounds(function(x), x, [(ends[0], ends[1])])
    with localcontext() as context:
        context.prec = 60
        # At the very ends of asin and acos the bound lies beyond what the inverse tells of.
        if least < ends[0] and ends[1] < most:
            assert inverse(Decimal(low)) <= Decimal(ends[0])
            assert Decimal(ends[1]) <= inverse(Decimal(high))


operations = pytest.mark.parametrize("name", [name for name in OPERATIONS if name != "asinh"])


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
    sides = [a, b][: operation.arguments]
    low, high, _ = compiled(name)(sides)
    others = within(b, share) if operation.arguments == 2 else [None]
    for x in within(a, share):
        for y in others:
            assert is_held(low, true_value(operation, x, y), high), (x, y)


def test_a_wave_reaches_its_extremes_inside_a_box():
    x = ca.SX.sym("x")
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


def test_an_operation_without_a_rule_is_refused_by_name():
    x = ca.SX.sym("x")
    with pytest.raises(UncertifiableError, match="'erf'"):
        IntervalFunction([x], [ca.erf(x)])


def test_the_norm_of_nothing_is_nothing():
    assert norm(point(np.zeros((3, 1)))).hi[0] < 1e-150
