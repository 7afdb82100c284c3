"""Intervals with symbolic ends, and a rule for every operation on them.

Each operation that can jump also has the condition under which it does not. With ends rounded
outwards, the result of every rule contains all true values for all numbers in its arguments.
IEEE 754 bounds the error of + - * / and √, `exponential` and `circular` that of other functions.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache, partial, wraps
from typing import NamedTuple

import casadi as ca

from phalanx.theory.expressions.rounding import LEAST, error_bound, rounds_outwards

_LARGE = 1e30
_LIBRARY = 16
"""Assumed error of library functions [float64]; the actual one is a few."""
_FAR = 1e5
"""Angle up to which sine, cosine and tangent are exact to their last digits [rad]."""

# The most frequent operations: a + b itself searches for its overload, seven times as long.
_plus, _times = partial(ca.SX.binary, ca.OP_ADD), partial(ca.SX.binary, ca.OP_MUL)
_minus = partial(ca.SX.binary, ca.OP_SUB)
_least, _most = partial(ca.SX.binary, ca.OP_FMIN), partial(ca.SX.binary, ca.OP_FMAX)


class UnboundedOperationError(ValueError):
    """An expression uses an operation that has no interval rule; the message names it."""


class Interval(NamedTuple):
    """All numbers from lo to hi; scalars, symbolic or constant."""

    lo: ca.SX
    hi: ca.SX


def point(value: ca.SX | float) -> Interval:
    """The interval that contains one number."""
    number = ca.SX(value)
    return Interval(number, number)


def _written_once(rule: Callable[..., Interval]) -> Callable[..., Interval]:
    """A rule as a CasADi function, which is expanded faster than Python code."""

    @cache
    def function(points: tuple[bool, ...], outwards: bool) -> ca.Function:
        a = [point(ca.SX.sym("a")) if p else Interval(*ca.SX.sym("a", 1, 1, 2)) for p in points]
        return ca.Function("rule", _ends(a, points), [*rule(*a)])

    @wraps(rule)
    def write(*intervals: Interval) -> Interval:
        points = tuple(map(_is_point, intervals))
        return Interval(*function(points, rounds_outwards()).call(_ends(intervals, points)))

    return write


def _ends(intervals: Sequence[Interval], points: Sequence[bool]) -> list[ca.SX]:
    """Both ends of each interval, or its one number if it is a point."""
    pairs = zip(intervals, points, strict=True)
    return [end for interval, is_point in pairs for end in interval[is_point:]]


def _rounded(a: Interval, steps: int = 1, least: float = LEAST) -> Interval:
    """a, widened by its rounding error of `steps` float64 and `least` if ends round outwards."""
    if not rounds_outwards():
        return a
    below = error_bound(a.lo, steps, least)
    above = below if _is_point(a) else error_bound(a.hi, steps, least)
    return Interval(_minus(a.lo, below), _plus(a.hi, above))


def _not_below_zero(a: Interval) -> Interval:
    """a without numbers below zero, which rounding outwards may have added."""
    return Interval(_most(a.lo, 0), a.hi) if rounds_outwards() else a


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    total = Interval(_plus(a.lo, b.lo), _plus(a.hi, b.hi))
    # Sums too small for a normal number are exact.
    return total if _is_zero(a) or _is_zero(b) else _rounded(total, least=0.0)


def negate(a: Interval) -> Interval:
    """-a."""
    return Interval(-a.hi, -a.lo)


def multiply(a: Interval, b: Interval) -> Interval:
    """a b; 0 ∞ must not occur: it is NaN, which min and max ignore."""
    for factor, other in ((a, b), (b, a)):
        if is_number(factor):
            ends = _times(factor.lo, other.lo), _times(factor.lo, other.hi)
            number = float(factor.lo)
            product = Interval(*ends) if number >= 0.0 else Interval(*reversed(ends))
            return product if number in (-1.0, 0.0, 1.0) else _rounded(product)
    return _product(a, b)


@_written_once
def _product(a: Interval, b: Interval) -> Interval:
    # A point has one end, so that two of the four products are the other two.
    first = [a.lo] if _is_point(a) else [a.lo, a.hi]
    second = [b.lo] if _is_point(b) else [b.lo, b.hi]
    ends = ca.vertcat(*[x * y for x in first for y in second])
    return _rounded(Interval(ca.mmin(ends), ca.mmax(ends)))


def _is_zero(a: Interval) -> bool:
    return bool(a.lo.is_zero() and a.hi.is_zero())


def is_number(a: Interval) -> bool:
    """Return whether a is one finite constant."""
    return a.lo.is_constant() and _is_point(a) and math.isfinite(float(a.lo))


def finite(intervals: Iterable[Interval]) -> ca.SX:
    """1 if all ends are numbers, so far from infinite that no product of ten of them is."""
    ends = [end for a in intervals for end in (a[:1] if _is_point(a) else a)]
    return ca.norm_1(ca.SX(ca.vertcat(*ends))) < _LARGE


def _is_point(a: Interval) -> bool:
    return bool(a.lo.element_hash() == a.hi.element_hash())


def hull(a: Interval, b: Interval) -> Interval:
    """The smallest interval that contains both."""
    return Interval(_least(a.lo, b.lo), _most(a.hi, b.hi))


def intersection(a: Interval, b: Interval) -> Interval:
    """The numbers that lie in both."""
    return Interval(_most(a.lo, b.lo), _least(a.hi, b.hi))


def inflate(a: Interval, share: float, least: float) -> Interval:
    """a, wider on both sides by a share of its width and by `least`."""
    extra = share * (a.hi - a.lo) + least
    return Interval(a.lo - extra, a.hi + extra)


def inside(a: Interval, b: Interval) -> ca.SX:
    """1 if a lies within b."""
    return ca.logic_and(a.lo >= b.lo, a.hi <= b.hi)


def subtract(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return add(a, negate(b))


@_written_once
def square(a: Interval) -> Interval:
    """a a, which is not below zero."""
    low, high = a.lo * a.lo, a.hi * a.hi
    crosses = ca.logic_and(a.lo <= 0, a.hi >= 0)
    squares = Interval(ca.if_else(crosses, 0, ca.fmin(low, high)), ca.fmax(low, high))
    return _not_below_zero(_rounded(squares))


@_written_once
def reciprocal(a: Interval) -> Interval:
    """1/a; unbounded if a contains zero."""
    defined = without_zero(a)
    inverse = _rounded(Interval(1 / a.hi, 1 / a.lo))
    return Interval(
        ca.if_else(defined, inverse.lo, -ca.inf), ca.if_else(defined, inverse.hi, ca.inf)
    )


@_written_once
def absolute(a: Interval) -> Interval:
    """|a|."""
    crosses = ca.logic_and(a.lo <= 0, a.hi >= 0)
    low, high = ca.fabs(a.lo), ca.fabs(a.hi)
    return Interval(ca.if_else(crosses, 0, ca.fmin(low, high)), ca.fmax(low, high))


@_written_once
def cosine(a: Interval) -> Interval:
    """cos a."""

    def reaches(phase: float) -> ca.SX:
        """1 if phase + 2πk may lie in a for some integer k; so close to it, cos is ±1."""
        first, last = ((end - phase) / (2 * math.pi) for end in a)
        return ca.ceil(first - _TURN) <= last + _TURN

    low, high = ca.cos(a.lo), ca.cos(a.hi)
    ends = _rounded(Interval(ca.fmin(low, high), ca.fmax(low, high)), _LIBRARY)
    far = ca.logic_not(_is_near(a))
    return Interval(
        ca.if_else(ca.logic_or(far, reaches(math.pi)), -1, ends.lo),
        ca.if_else(ca.logic_or(far, reaches(0.0)), 1, ends.hi),
    )


_TURN = 1e-10
"""More than the error of a quotient by 2π; cos is ±1 in all its digits within it."""


def _is_near(a: Interval) -> ca.SX:
    """1 if a lies where angles are exact enough."""
    return ca.fabs(a.lo) + ca.fabs(a.hi) <= 2 * _FAR


def sine(a: Interval) -> Interval:
    """sin a."""
    return cosine(subtract(a, _rounded(point(math.pi / 2))))


def power(a: Interval, b: Interval) -> Interval:
    """a to a constant power; unbounded if that is no integer and a reaches below zero."""
    exponent = _exponent(b)
    if exponent < 0:
        return reciprocal(power(a, point(-exponent)))
    if not exponent.is_integer():
        return above_zero(lambda end: end**exponent)(a)
    base = absolute(a) if exponent % 2 == 0 else a
    return _rounded(Interval(base.lo**exponent, base.hi**exponent), _LIBRARY)


def power_is_continuous(a: Interval, b: Interval) -> ca.SX:
    """1 if a to a constant power can neither jump nor be undefined."""
    exponent = _exponent(b)
    defined = ca.SX(1) if exponent.is_integer() else a.lo >= 0
    return ca.logic_and(defined, without_zero(a)) if exponent < 0 else defined


def _exponent(b: Interval) -> float:
    if not (b.lo.is_constant() and b.hi.is_constant() and float(b.lo) == float(b.hi)):
        raise UnboundedOperationError("no interval rule for a power that is not constant")
    return float(b.lo)


def stepping(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """The rule of an exact function that never falls."""
    return lambda a: Interval(function(a.lo), function(a.hi))


def increasing(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """The rule of a library function that never falls."""
    return lambda a: _rounded(Interval(function(a.lo), function(a.hi)), _LIBRARY)


def exponential(a: Interval) -> Interval:
    """e^a, which is not below zero."""
    return _not_below_zero(increasing(ca.exp)(a))


def above_zero(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """The rule of an increasing function of numbers >= 0; unbounded if a reaches below zero."""

    def rule(a: Interval) -> Interval:
        defined = a.lo >= 0
        low, high = increasing(function)(Interval(ca.fmax(a.lo, 0), ca.fmax(a.hi, 0)))
        return Interval(ca.if_else(defined, low, -ca.inf), ca.if_else(defined, high, ca.inf))

    return rule


def without_zero(a: Interval) -> ca.SX:
    """1 if zero is not in a."""
    return ca.logic_or(a.lo > 0, a.hi < 0)


def one_sign(a: Interval) -> ca.SX:
    """1 if all of a has one sign, and so one truth value."""
    return ca.logic_or(without_zero(a), ca.logic_and(a.lo == 0, a.hi == 0))


def truth(always: ca.SX, never: ca.SX) -> Interval:
    """1 if always, 0 if never, else from 0 to 1."""
    return Interval(ca.if_else(always, 1, 0), ca.if_else(never, 0, 1))


def truth_of(a: Interval) -> Interval:
    """1 if all of a is true, that is not zero; 0 if none is."""
    zero = ca.logic_and(a.lo == 0, a.hi == 0)
    return truth(without_zero(a), zero)


def logical_not(a: Interval) -> Interval:
    """1 if all of a is false, 0 if none is."""
    true = truth_of(a)
    return Interval(1 - true.hi, 1 - true.lo)


def logical_and(a: Interval, b: Interval) -> Interval:
    """1 if all of a and of b is true, 0 if none of one of them is."""
    return smaller(truth_of(a), truth_of(b))


def logical_or(a: Interval, b: Interval) -> Interval:
    """1 if all of one of them is true, 0 if none of both is."""
    return logical_not(logical_and(logical_not(a), logical_not(b)))


def smaller(a: Interval, b: Interval) -> Interval:
    """The smaller of both numbers."""
    return Interval(_least(a.lo, b.lo), _least(a.hi, b.hi))


def larger(a: Interval, b: Interval) -> Interval:
    """The larger of both numbers."""
    return Interval(_most(a.lo, b.lo), _most(a.hi, b.hi))


def equal(a: Interval, b: Interval) -> Interval:
    """1 if a and b are the same single number, 0 if they are disjoint."""
    d = subtract(a, b)
    return truth(ca.logic_and(d.lo == 0, d.hi == 0), without_zero(d))


@_written_once
def if_else_zero(condition: Interval, value: Interval) -> Interval:
    """The value where the condition is true, else zero."""
    true = truth_of(condition)
    low, high = ca.fmin(value.lo, 0), ca.fmax(value.hi, 0)
    return Interval(
        ca.if_else(true.lo, value.lo, ca.if_else(true.hi, low, 0)),
        ca.if_else(true.lo, value.hi, ca.if_else(true.hi, high, 0)),
    )


@_written_once
def angle(y: Interval, x: Interval) -> Interval:
    """atan2, extreme at the box's corners; all angles if the box meets the branch cut."""
    corners = ca.vertcat(*[ca.atan2(b, a) for b in y for a in x])
    defined = avoids_branch_cut(y, x)
    low = ca.if_else(defined, ca.mmin(corners), -math.pi)
    high = ca.if_else(defined, ca.mmax(corners), math.pi)
    return _rounded(Interval(low, high), _LIBRARY)


def avoids_branch_cut(y: Interval, x: Interval) -> ca.SX:
    """1 if no (x, y) lies on the left half of the x axis."""
    return ca.logic_or(x.lo > 0, ca.logic_or(y.lo > 0, y.hi < 0))


def tangent(a: Interval) -> Interval:
    """tan a; unbounded if a contains a pole."""
    branch, values = one_branch(a), increasing(ca.tan)(a)
    return Interval(ca.if_else(branch, values.lo, -ca.inf), ca.if_else(branch, values.hi, ca.inf))


def one_branch(a: Interval) -> ca.SX:
    """1 if the tangent has no pole in a, nor one so close that rounding would decide."""
    first, last = ((end / math.pi + 0.5) for end in a)
    return ca.logic_and(_is_near(a), ca.floor(first - _POLE) == ca.floor(last + _POLE))


_POLE = 1e-9


def steps(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], ca.SX]:
    """The condition under which an increasing step function takes no step."""
    return lambda a: function(a.lo) == function(a.hi)
