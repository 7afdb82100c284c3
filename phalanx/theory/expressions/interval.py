"""Interval extension of CasADi expressions: bounds over a box, themselves expressions.

The bounds are compiled like everything else, so that a control step can afford them. They are
exact up to rounding for each operation, and conservative where a variable occurs twice. Beside
its rule each operation that can jump has the condition under which it does not.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from typing import NamedTuple

import casadi as ca


class UnboundedOperationError(ValueError):
    """An expression uses an operation that has no interval rule; the message names it."""


class Interval(NamedTuple):
    """All numbers from lo to hi; scalars, symbolic or constant."""

    lo: ca.SX
    hi: ca.SX


def point(value: ca.SX | float) -> Interval:
    """The interval that holds one number."""
    number = ca.SX(value)
    return Interval(number, number)


def _written_once(rule: Callable[..., Interval]) -> Callable[..., Interval]:
    """A rule as a CasADi function, which writes its operations out faster than Python can."""

    @cache
    def function(points: tuple[bool, ...]) -> ca.Function:
        a = [point(ca.SX.sym("a")) if p else Interval(*ca.SX.sym("a", 1, 1, 2)) for p in points]
        return ca.Function("rule", _ends(a, points), [*rule(*a)])

    @wraps(rule)
    def write(*intervals: Interval) -> Interval:
        points = tuple(map(_is_point, intervals))
        return Interval(*function(points).call(_ends(intervals, points)))

    return write


def _ends(intervals: Sequence[Interval], points: Sequence[bool]) -> list[ca.SX]:
    """Both ends of each interval, or the one number that it holds."""
    each = zip(intervals, points, strict=True)
    return [end for interval, is_point in each for end in interval[is_point:]]


def extend(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> list[Interval]:
    """Bounds of scalar expressions while each scalar symbol moves within its interval.

    Raises:
        UnboundedOperationError: an operation has no rule here.
        RuntimeError: an expression contains other symbols (from CasADi).
    """
    return _extend(expressions, symbols, box)[0]


def continuous(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> ca.SX:
    """1 if no expression can jump in the box, or leave where it is defined, else 0.

    A kink, such as that of |x|, is a jump of its derivative, which is what rows are made of.

    Raises:
        UnboundedOperationError: as extend does.
    """
    kept = ca.SX(1)
    for condition in _extend(expressions, symbols, box)[1]:
        kept = ca.logic_and(kept, condition)
    return kept


def _extend(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> tuple[list[Interval], list[ca.SX]]:
    """The bounds, and for each operation that can jump whether it does not."""
    f = ca.Function("f", [ca.vertcat(*symbols)], [ca.densify(ca.vertcat(*expressions))])
    work: dict[int, Interval] = {}
    conditions: list[ca.SX] = []
    results = [point(0.0)] * len(expressions)
    for k in range(f.n_instructions()):
        op, sources, targets = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_CONST:
            work[targets[0]] = point(f.instruction_constant(k))
        elif op == ca.OP_INPUT:
            work[targets[0]] = box[sources[1]]
        elif op == ca.OP_OUTPUT:
            results[targets[1]] = work[sources[0]]
        elif op in _RULES:
            arguments = [work[s] for s in sources]
            if op in _CONTINUOUS:
                conditions.append(_CONTINUOUS[op](*arguments))
            work[targets[0]] = _RULES[op](*arguments)
        else:
            raise UnboundedOperationError(f"no interval rule for the operation {_name(op)}")
    return results, conditions


def _name(op: int) -> str:
    """CasADi's own word for an operation, such as fmod."""
    return next(n[3:].lower() for n in vars(ca) if n.startswith("OP_") and getattr(ca, n) == op)


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return Interval(a.lo + b.lo, a.hi + b.hi)


def negate(a: Interval) -> Interval:
    """-a."""
    return Interval(-a.hi, -a.lo)


@_written_once
def multiply(a: Interval, b: Interval) -> Interval:
    """a b; everything where zero meets infinity, whose product is not a number."""
    # Of a number both ends are one expression, and of the four products two are two others.
    first = [a.lo] if _is_point(a) else [a.lo, a.hi]
    second = [b.lo] if _is_point(b) else [b.lo, b.hi]
    ends = ca.vertcat(*[x * y for x in first for y in second])
    # Comparisons are false for NaN, which min and max would pass over.
    known = ca.sum1(ends) <= ca.inf
    return Interval(
        ca.if_else(known, ca.mmin(ends), -ca.inf), ca.if_else(known, ca.mmax(ends), ca.inf)
    )


def _is_point(a: Interval) -> bool:
    return bool(a.lo.element_hash() == a.hi.element_hash())


def hull(a: Interval, b: Interval) -> Interval:
    """The smallest interval that holds both."""
    return Interval(ca.fmin(a.lo, b.lo), ca.fmax(a.hi, b.hi))


def inflate(a: Interval, share: float, least: float) -> Interval:
    """a, wider on both sides by a share of its width and at least `least`."""
    extra = share * (a.hi - a.lo) + least
    return Interval(a.lo - extra, a.hi + extra)


def inside(a: Interval, b: Interval) -> ca.SX:
    """1 if a lies within b."""
    return ca.logic_and(a.lo >= b.lo, a.hi <= b.hi)


def subtract(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return add(a, negate(b))


@_written_once
def _square(a: Interval) -> Interval:
    low, high = a.lo * a.lo, a.hi * a.hi
    crosses = ca.logic_and(a.lo <= 0, a.hi >= 0)
    return Interval(ca.if_else(crosses, 0, ca.fmin(low, high)), ca.fmax(low, high))


@_written_once
def _reciprocal(a: Interval) -> Interval:
    apart = ca.logic_or(a.lo > 0, a.hi < 0)
    return Interval(ca.if_else(apart, 1 / a.hi, -ca.inf), ca.if_else(apart, 1 / a.lo, ca.inf))


@_written_once
def _absolute(a: Interval) -> Interval:
    crosses = ca.logic_and(a.lo <= 0, a.hi >= 0)
    low, high = ca.fabs(a.lo), ca.fabs(a.hi)
    return Interval(ca.if_else(crosses, 0, ca.fmin(low, high)), ca.fmax(low, high))


@_written_once
def _cosine(a: Interval) -> Interval:
    def reaches(phase: float) -> ca.SX:
        """Whether phase + 2πk lies in a, for some whole k."""
        first = ca.ceil((a.lo - phase) / (2 * math.pi))
        return first <= (a.hi - phase) / (2 * math.pi)

    low, high = ca.cos(a.lo), ca.cos(a.hi)
    return Interval(
        ca.if_else(reaches(math.pi), -1, ca.fmin(low, high)),
        ca.if_else(reaches(0.0), 1, ca.fmax(low, high)),
    )


def _sine(a: Interval) -> Interval:
    return _cosine(Interval(a.lo - math.pi / 2, a.hi - math.pi / 2))


def _power(a: Interval, b: Interval) -> Interval:
    """a to a constant power; for one that is not whole a must not reach below zero."""
    exponent = _exponent(b)
    if exponent < 0:
        return _reciprocal(_power(a, point(-exponent)))
    if not exponent.is_integer():
        low, high = ca.fmax(a.lo, 0) ** exponent, ca.fmax(a.hi, 0) ** exponent
        defined = a.lo >= 0
        return Interval(ca.if_else(defined, low, -ca.inf), ca.if_else(defined, high, ca.inf))
    base = _absolute(a) if exponent % 2 == 0 else a
    return Interval(base.lo**exponent, base.hi**exponent)


def _power_is_continuous(a: Interval, b: Interval) -> ca.SX:
    exponent = _exponent(b)
    defined = ca.SX(1) if exponent.is_integer() else a.lo >= 0
    return ca.logic_and(defined, _apart(a)) if exponent < 0 else defined


def _exponent(b: Interval) -> float:
    if not (b.lo.is_constant() and b.hi.is_constant() and float(b.lo) == float(b.hi)):
        raise UnboundedOperationError("no interval rule for a power that is not constant")
    return float(b.lo)


def _increasing(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    return lambda a: Interval(function(a.lo), function(a.hi))


def _above_zero(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """An increasing function of numbers from zero on; unbounded where a reaches below."""

    def rule(a: Interval) -> Interval:
        defined = a.lo >= 0
        low, high = function(ca.fmax(a.lo, 0)), function(ca.fmax(a.hi, 0))
        return Interval(ca.if_else(defined, low, -ca.inf), ca.if_else(defined, high, ca.inf))

    return rule


def _apart(a: Interval) -> ca.SX:
    """1 if zero is not in a."""
    return ca.logic_or(a.lo > 0, a.hi < 0)


def _settled(a: Interval) -> ca.SX:
    """1 if all of a has one sign, which is also one truth: what is not zero is true."""
    return ca.logic_or(_apart(a), ca.logic_and(a.lo == 0, a.hi == 0))


def _truth(always: ca.SX, never: ca.SX) -> Interval:
    """1 if always, 0 if never, else from 0 to 1."""
    return Interval(ca.if_else(always, 1, 0), ca.if_else(never, 0, 1))


def _true(a: Interval) -> Interval:
    zero = ca.logic_and(a.lo == 0, a.hi == 0)
    return _truth(_apart(a), zero)


def _not(a: Interval) -> Interval:
    return subtract(point(1.0), _true(a))


def _equal(a: Interval, b: Interval) -> Interval:
    d = subtract(a, b)
    return _truth(ca.logic_and(d.lo == 0, d.hi == 0), _apart(d))


@_written_once
def _where(condition: Interval, value: Interval) -> Interval:
    """The value where the condition is true, else zero."""
    true = _true(condition)
    low, high = ca.fmin(value.lo, 0), ca.fmax(value.hi, 0)
    return Interval(
        ca.if_else(true.lo, value.lo, ca.if_else(true.hi, low, 0)),
        ca.if_else(true.lo, value.hi, ca.if_else(true.hi, high, 0)),
    )


@_written_once
def _angle(y: Interval, x: Interval) -> Interval:
    """atan2; every angle where the box meets the cut, else extreme at corners, as angles are."""
    corners = ca.vertcat(*[ca.atan2(b, a) for b in y for a in x])
    apart = _beside_the_cut(y, x)
    return Interval(
        ca.if_else(apart, ca.mmin(corners), -math.pi), ca.if_else(apart, ca.mmax(corners), math.pi)
    )


def _beside_the_cut(y: Interval, x: Interval) -> ca.SX:
    """1 if no (x, y) lies on the left half of the x axis."""
    return ca.logic_or(x.lo > 0, ca.logic_or(y.lo > 0, y.hi < 0))


def _tangent(a: Interval) -> Interval:
    one = _one_branch(a)
    return Interval(ca.if_else(one, ca.tan(a.lo), -ca.inf), ca.if_else(one, ca.tan(a.hi), ca.inf))


def _one_branch(a: Interval) -> ca.SX:
    """1 if a tangent has no pole in a; what is so near to one that rounding decides counts as 0."""
    first, last = ((end / math.pi + 0.5) for end in a)
    return ca.floor(first - _POLE) == ca.floor(last + _POLE)


_POLE = 1e-9


def _steps(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], ca.SX]:
    """Whether an increasing function of whole steps takes none."""
    return lambda a: function(a.lo) == function(a.hi)


_RULES: Mapping[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: add,
    ca.OP_SUB: subtract,
    ca.OP_NEG: negate,
    ca.OP_MUL: multiply,
    ca.OP_DIV: lambda a, b: multiply(a, _reciprocal(b)),
    ca.OP_INV: _reciprocal,
    ca.OP_SQ: _square,
    ca.OP_TWICE: lambda a: add(a, a),
    ca.OP_SQRT: _above_zero(ca.sqrt),
    ca.OP_EXP: _increasing(ca.exp),
    ca.OP_LOG: _above_zero(ca.log),
    ca.OP_SIGN: _increasing(ca.sign),
    ca.OP_FLOOR: _increasing(ca.floor),
    ca.OP_CEIL: _increasing(ca.ceil),
    ca.OP_SINH: _increasing(ca.sinh),
    ca.OP_TANH: _increasing(ca.tanh),
    ca.OP_ASINH: _increasing(ca.asinh),
    ca.OP_ATAN: _increasing(ca.atan),
    ca.OP_ATAN2: _angle,
    ca.OP_TAN: _tangent,
    ca.OP_LT: lambda a, b: _truth(a.hi < b.lo, a.lo >= b.hi),
    ca.OP_LE: lambda a, b: _truth(a.hi <= b.lo, a.lo > b.hi),
    ca.OP_EQ: _equal,
    ca.OP_NE: lambda a, b: _not(_equal(a, b)),
    ca.OP_NOT: _not,
    ca.OP_AND: lambda a, b: multiply(_true(a), _true(b)),
    ca.OP_OR: lambda a, b: _not(multiply(_not(a), _not(b))),
    ca.OP_IF_ELSE_ZERO: _where,
    ca.OP_SIN: _sine,
    ca.OP_COS: _cosine,
    ca.OP_FABS: _absolute,
    ca.OP_CONSTPOW: _power,
    ca.OP_POW: _power,
    ca.OP_FMAX: lambda a, b: Interval(ca.fmax(a.lo, b.lo), ca.fmax(a.hi, b.hi)),
    ca.OP_FMIN: lambda a, b: Interval(ca.fmin(a.lo, b.lo), ca.fmin(a.hi, b.hi)),
}

_CONTINUOUS: Mapping[int, Callable[..., ca.SX]] = {
    ca.OP_SIGN: _settled,
    ca.OP_FLOOR: _steps(ca.floor),
    ca.OP_CEIL: _steps(ca.ceil),
    ca.OP_ATAN2: _beside_the_cut,
    ca.OP_TAN: _one_branch,
    ca.OP_LT: lambda a, b: _settled(subtract(a, b)),
    ca.OP_LE: lambda a, b: _settled(subtract(a, b)),
    ca.OP_EQ: lambda a, b: _settled(subtract(a, b)),
    ca.OP_NE: lambda a, b: _settled(subtract(a, b)),
    ca.OP_NOT: _settled,
    ca.OP_AND: lambda a, b: ca.logic_and(_settled(a), _settled(b)),
    ca.OP_OR: lambda a, b: ca.logic_and(_settled(a), _settled(b)),
    ca.OP_IF_ELSE_ZERO: lambda condition, _: _settled(condition),
    ca.OP_DIV: lambda _, b: _apart(b),
    ca.OP_INV: _apart,
    ca.OP_LOG: lambda a: a.lo > 0,
    ca.OP_SQRT: lambda a: a.lo >= 0,
    ca.OP_POW: _power_is_continuous,
    ca.OP_CONSTPOW: _power_is_continuous,
}
