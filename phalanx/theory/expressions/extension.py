"""Interval extension of CasADi expressions: bounds over a box, themselves expressions.

The bounds are compiled like everything else, so that a control step can afford them. They are
exact up to rounding for each operation, which goes to nearest or `outwards`, and conservative where
a variable occurs twice.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import casadi as ca

from phalanx.theory.expressions.interval import (
    Interval,
    UnboundedOperationError,
    above_zero,
    absolute,
    add,
    angle,
    beside_the_cut,
    both,
    cosine,
    equal,
    exponential,
    finite,
    if_else_zero,
    increasing,
    is_number,
    logical_not,
    multiply,
    negate,
    one_branch,
    one_sign,
    point,
    power,
    power_is_continuous,
    reciprocal,
    sine,
    square,
    stepping,
    steps,
    subtract,
    tangent,
    truth,
    without_zero,
)


def extend(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> list[Interval]:
    """Bounds of scalar expressions while each scalar symbol moves within its interval.

    Everything where an argument of a product, or of what else min and max are part of, has no
    bound: zero could meet infinity there, or infinity another, and min and max pass over that.

    Raises:
        UnboundedOperationError: an operation has no rule here.
        RuntimeError: an expression contains other symbols (from CasADi).
    """
    extension = _Extension()
    bounds = extension.of(expressions, symbols, box)
    if not (factors := extension.factors()):
        return bounds
    known = finite(factors)
    return [
        Interval(ca.if_else(known, a.lo, -ca.inf), ca.if_else(known, a.hi, ca.inf)) for a in bounds
    ]


def continuous(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> ca.SX:
    """1 if no expression can jump in the box, or leave where it is defined, else 0.

    A kink, such as that of |x|, is a jump of its derivative, which is what rows are made of.

    Raises:
        UnboundedOperationError: as extend does.
    """
    extension = _Extension()
    extension.of(expressions, symbols, box)
    kept = finite(extension.factors())
    for condition in extension.conditions:
        kept = ca.logic_and(kept, condition)
    return kept


class _Bounds(NamedTuple):
    """Those of one step of an expression."""

    interval: Interval
    rest_on: frozenset[int]
    """Which of the watched intervals must be finite for this one to be."""


class _Extension:
    """The steps of expressions, one after the other."""

    def __init__(self) -> None:
        self.conditions: list[ca.SX] = []
        """For each operation that can jump whether it does not."""
        self._watched: list[Interval] = []
        """What may be infinite, although nothing was that it is made of."""
        self._needed: frozenset[int] = frozenset()
        self._reciprocals: dict[tuple[int, int], tuple[Interval, _Bounds]] = {}

    def of(
        self, expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
    ) -> list[Interval]:
        """Their bounds, if all `factors` are finite."""
        f = ca.Function("f", [ca.vertcat(*symbols)], [ca.densify(ca.vertcat(*expressions))])
        work: dict[int, _Bounds] = {}
        given = [self._given(interval) for interval in box]
        results = [point(0.0)] * len(expressions)
        for k in range(f.n_instructions()):
            op, sources = f.instruction_id(k), f.instruction_input(k)
            targets = f.instruction_output(k)
            if op == ca.OP_CONST:
                work[targets[0]] = self._given(point(f.instruction_constant(k)))
            elif op == ca.OP_INPUT:
                work[targets[0]] = given[sources[1]]
            elif op == ca.OP_OUTPUT:
                results[targets[1]] = work[sources[0]].interval
            else:
                work[targets[0]] = self._step(op, [work[s] for s in sources])
        return results

    def factors(self) -> list[Interval]:
        """What must be finite for all products to be right."""
        return [self._watched[k] for k in sorted(self._needed)]

    def _given(self, interval: Interval) -> _Bounds:
        known = all(end.is_constant() and math.isfinite(float(end)) for end in interval)
        return _Bounds(interval, frozenset() if known else self._watch(interval))

    def _watch(self, interval: Interval) -> frozenset[int]:
        self._watched.append(interval)
        return frozenset([len(self._watched) - 1])

    def _step(self, op: int, arguments: Sequence[_Bounds]) -> _Bounds:
        """Raises UnboundedOperationError."""
        if op == ca.OP_DIV:
            return self._step(ca.OP_MUL, [arguments[0], self._reciprocal(arguments[1])])
        if op not in _RULES:
            raise UnboundedOperationError(f"no interval rule for the operation {_name(op)}")
        intervals = [a.interval for a in arguments]
        if op in _CONTINUOUS:
            self.conditions.append(_CONTINUOUS[op](*intervals))
        found = _RULES[op](*intervals)
        rest_on = frozenset[int]().union(*[a.rest_on for a in arguments])
        by_a_number = op == ca.OP_MUL and any(map(is_number, intervals))
        if op in _PASSING_OVER and not by_a_number:
            self._needed |= rest_on
        if op in _UNBOUNDED:
            rest_on = self._watch(found)
        return _Bounds(found, frozenset() if op in _BOUNDED else rest_on)

    def _reciprocal(self, a: _Bounds) -> _Bounds:
        """1/a, written once for all that are divided by it."""
        ends = a.interval.lo.element_hash(), a.interval.hi.element_hash()
        if ends not in self._reciprocals:
            # The interval is kept too: while it lives, nothing else has its hash.
            self._reciprocals[ends] = a.interval, self._step(ca.OP_INV, [a])
        return self._reciprocals[ends][1]


def _name(op: int) -> str:
    """CasADi's own word for an operation, such as fmod."""
    return next(n[3:].lower() for n in vars(ca) if n.startswith("OP_") and getattr(ca, n) == op)


_RULES: Mapping[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: add,
    ca.OP_SUB: subtract,
    ca.OP_NEG: negate,
    ca.OP_MUL: multiply,
    ca.OP_INV: reciprocal,
    ca.OP_SQ: square,
    ca.OP_TWICE: lambda a: add(a, a),
    ca.OP_SQRT: above_zero(ca.sqrt),
    ca.OP_EXP: exponential,
    ca.OP_LOG: above_zero(ca.log),
    ca.OP_SIGN: stepping(ca.sign),
    ca.OP_FLOOR: stepping(ca.floor),
    ca.OP_CEIL: stepping(ca.ceil),
    ca.OP_SINH: increasing(ca.sinh),
    ca.OP_TANH: increasing(ca.tanh),
    ca.OP_ASINH: increasing(ca.asinh),
    ca.OP_ATAN: increasing(ca.atan),
    ca.OP_ATAN2: angle,
    ca.OP_TAN: tangent,
    ca.OP_LT: lambda a, b: truth(a.hi < b.lo, a.lo >= b.hi),
    ca.OP_LE: lambda a, b: truth(a.hi <= b.lo, a.lo > b.hi),
    ca.OP_EQ: equal,
    ca.OP_NE: lambda a, b: logical_not(equal(a, b)),
    ca.OP_NOT: logical_not,
    ca.OP_AND: both,
    ca.OP_OR: lambda a, b: logical_not(both(logical_not(a), logical_not(b))),
    ca.OP_IF_ELSE_ZERO: if_else_zero,
    ca.OP_SIN: sine,
    ca.OP_COS: cosine,
    ca.OP_FABS: absolute,
    ca.OP_CONSTPOW: power,
    ca.OP_POW: power,
    ca.OP_FMAX: lambda a, b: Interval(ca.fmax(a.lo, b.lo), ca.fmax(a.hi, b.hi)),
    ca.OP_FMIN: lambda a, b: Interval(ca.fmin(a.lo, b.lo), ca.fmin(a.hi, b.hi)),
}

_CONTINUOUS: Mapping[int, Callable[..., ca.SX]] = {
    ca.OP_SIGN: one_sign,
    ca.OP_FLOOR: steps(ca.floor),
    ca.OP_CEIL: steps(ca.ceil),
    ca.OP_ATAN2: beside_the_cut,
    ca.OP_TAN: one_branch,
    ca.OP_LT: lambda a, b: one_sign(subtract(a, b)),
    ca.OP_LE: lambda a, b: one_sign(subtract(a, b)),
    ca.OP_EQ: lambda a, b: one_sign(subtract(a, b)),
    ca.OP_NE: lambda a, b: one_sign(subtract(a, b)),
    ca.OP_NOT: one_sign,
    ca.OP_AND: lambda a, b: ca.logic_and(one_sign(a), one_sign(b)),
    ca.OP_OR: lambda a, b: ca.logic_and(one_sign(a), one_sign(b)),
    ca.OP_IF_ELSE_ZERO: lambda condition, _: one_sign(condition),
    ca.OP_INV: without_zero,
    ca.OP_LOG: lambda a: a.lo > 0,
    ca.OP_SQRT: lambda a: a.lo >= 0,
    ca.OP_POW: power_is_continuous,
    ca.OP_CONSTPOW: power_is_continuous,
}

_PASSING_OVER = {
    ca.OP_MUL,
    ca.OP_SQ,
    ca.OP_FABS,
    ca.OP_FMIN,
    ca.OP_FMAX,
    ca.OP_ATAN2,
    ca.OP_IF_ELSE_ZERO,
    ca.OP_CONSTPOW,
    ca.OP_POW,
}
"""What min and max are part of: they pass over what is not a number."""

_UNBOUNDED = {
    ca.OP_INV,
    ca.OP_SQRT,
    ca.OP_EXP,
    ca.OP_LOG,
    ca.OP_SINH,
    ca.OP_TAN,
    ca.OP_CONSTPOW,
    ca.OP_POW,
}
"""What may be infinite where its arguments are not."""

_BOUNDED = {
    ca.OP_SIGN,
    ca.OP_TANH,
    ca.OP_ATAN,
    ca.OP_ATAN2,
    ca.OP_LT,
    ca.OP_LE,
    ca.OP_EQ,
    ca.OP_NE,
    ca.OP_NOT,
    ca.OP_AND,
    ca.OP_OR,
    ca.OP_SIN,
    ca.OP_COS,
}
"""What is finite wherever its arguments are."""
