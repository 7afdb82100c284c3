"""Interval extension of CasADi expressions: bounds over a box, themselves expressions.

The bounds are compiled like everything else, so that a control step can afford them. They are
exact up to rounding for each operation, and conservative where a variable occurs twice.
"""

import math
from collections.abc import Callable, Mapping, Sequence
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
    return Interval(ca.SX(value), ca.SX(value))


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
    """1 if no expression can jump in the box, else 0: whether every sign in them keeps its own.

    A kink, such as that of |x|, is a jump of its derivative, which is what rows are made of.
    """
    kept = ca.SX(1)
    for argument in _extend(expressions, symbols, box)[1]:
        kept = ca.logic_and(kept, ca.logic_or(argument.lo > 0, argument.hi < 0))
    return kept


def _extend(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> tuple[list[Interval], list[Interval]]:
    """The bounds, and those of the arguments of every sign."""
    f = ca.Function("f", [ca.vertcat(*symbols)], [ca.densify(ca.vertcat(*expressions))])
    work: dict[int, Interval] = {}
    signs: list[Interval] = []
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
            work[targets[0]] = _RULES[op](*[work[s] for s in sources])
            signs += [work[sources[0]]] if op == ca.OP_SIGN else []
        else:
            raise UnboundedOperationError(f"no interval rule for CasADi operation {op}")
    return results, signs


def add(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return Interval(a.lo + b.lo, a.hi + b.hi)


def negate(a: Interval) -> Interval:
    """-a."""
    return Interval(-a.hi, -a.lo)


def multiply(a: Interval, b: Interval) -> Interval:
    """a b; everything where zero meets infinity, whose product is not a number."""
    ends = ca.vertcat(a.lo * b.lo, a.lo * b.hi, a.hi * b.lo, a.hi * b.hi)
    # Comparisons are false for NaN, which min and max would pass over.
    known = ca.sum1(ends) <= ca.inf
    return Interval(
        ca.if_else(known, ca.mmin(ends), -ca.inf), ca.if_else(known, ca.mmax(ends), ca.inf)
    )


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


def _square(a: Interval) -> Interval:
    low, high = a.lo * a.lo, a.hi * a.hi
    crosses = ca.logic_and(a.lo <= 0, a.hi >= 0)
    return Interval(ca.if_else(crosses, 0, ca.fmin(low, high)), ca.fmax(low, high))


def _reciprocal(a: Interval) -> Interval:
    apart = ca.logic_or(a.lo > 0, a.hi < 0)
    return Interval(ca.if_else(apart, 1 / a.hi, -ca.inf), ca.if_else(apart, 1 / a.lo, ca.inf))


def _absolute(a: Interval) -> Interval:
    crosses = ca.logic_and(a.lo <= 0, a.hi >= 0)
    low, high = ca.fabs(a.lo), ca.fabs(a.hi)
    return Interval(ca.if_else(crosses, 0, ca.fmin(low, high)), ca.fmax(low, high))


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
    if not (b.lo.is_constant() and b.hi.is_constant() and float(b.lo) == float(b.hi)):
        raise UnboundedOperationError("no interval rule for a power that is not constant")
    exponent = float(b.lo)
    if exponent < 0:
        return _reciprocal(_power(a, point(-exponent)))
    if not exponent.is_integer():
        low, high = ca.fmax(a.lo, 0) ** exponent, ca.fmax(a.hi, 0) ** exponent
        defined = a.lo >= 0
        return Interval(ca.if_else(defined, low, -ca.inf), ca.if_else(defined, high, ca.inf))
    base = _absolute(a) if exponent % 2 == 0 else a
    return Interval(base.lo**exponent, base.hi**exponent)


def _increasing(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    return lambda a: Interval(function(a.lo), function(a.hi))


def _above_zero(function: Callable[[ca.SX], ca.SX]) -> Callable[[Interval], Interval]:
    """An increasing function of numbers from zero on; unbounded where a reaches below."""

    def rule(a: Interval) -> Interval:
        defined = a.lo >= 0
        low, high = function(ca.fmax(a.lo, 0)), function(ca.fmax(a.hi, 0))
        return Interval(ca.if_else(defined, low, -ca.inf), ca.if_else(defined, high, ca.inf))

    return rule


_RULES: Mapping[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: add,
    ca.OP_SUB: lambda a, b: add(a, negate(b)),
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
    ca.OP_SIN: _sine,
    ca.OP_COS: _cosine,
    ca.OP_FABS: _absolute,
    ca.OP_CONSTPOW: _power,
    ca.OP_POW: _power,
    ca.OP_FMAX: lambda a, b: Interval(ca.fmax(a.lo, b.lo), ca.fmax(a.hi, b.hi)),
    ca.OP_FMIN: lambda a, b: Interval(ca.fmin(a.lo, b.lo), ca.fmin(a.hi, b.hi)),
}
