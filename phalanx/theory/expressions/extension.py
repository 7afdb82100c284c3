"""Interval extension of CasADi expressions: bounds over a box, themselves expressions.

The bounds are compiled, so that a control step can afford them. For each operation they are exact
up to rounding, to nearest or `outwards`; where a variable occurs twice they are conservative.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import casadi as ca

from phalanx.theory.expressions import interval as rules
from phalanx.theory.expressions.instructions import evaluate
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, point


def extend(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> list[Interval]:
    """Bounds of scalar expressions while each scalar symbol moves within its interval.

    The bounds are -∞ and ∞ if an argument of a product, or of another rule that takes min and max,
    has no bound: 0 ∞ and ∞ - ∞ are NaN, which min and max ignore.

    Raises:
        UnboundedOperationError: an operation has no rule here.
        RuntimeError: an expression contains other symbols (from CasADi).
    """
    extension = _Extension()
    bounds = extension.of(expressions, symbols, box)
    if not (factors := extension.factors()):
        return bounds
    known = rules.finite(factors)
    return [
        Interval(ca.if_else(known, a.lo, -ca.inf), ca.if_else(known, a.hi, ca.inf)) for a in bounds
    ]


def continuous(
    expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
) -> ca.SX:
    """1 if no expression can jump in the box, or leave where it is defined, else 0.

    A kink, such as that of |x|, is a jump of the derivative; rows are made of derivatives.

    Raises:
        UnboundedOperationError: as extend does.
    """
    extension = _Extension()
    extension.of(expressions, symbols, box)
    kept = rules.finite(extension.factors())
    for condition in extension.conditions:
        kept = ca.logic_and(kept, condition)
    return kept


class _Bounds(NamedTuple):
    """Bounds of one step of an expression."""

    interval: Interval
    depends: frozenset[int]
    """The watched intervals that must be finite for this one to be finite."""


class _Extension:
    """Bounds of expressions, and the conditions under which they hold and are continuous."""

    def __init__(self) -> None:
        self.conditions: list[ca.SX] = []
        """For each operation that can jump: 1 if it does not."""
        self._watched: list[Interval] = []
        """Intervals that may be infinite although their arguments are finite."""
        self._needed: frozenset[int] = frozenset()
        self._reciprocals: dict[tuple[int, int], tuple[Interval, _Bounds]] = {}

    def of(
        self, expressions: Sequence[ca.SX], symbols: Sequence[ca.SX], box: Sequence[Interval]
    ) -> list[Interval]:
        """Bounds of the expressions; valid if all `factors` are finite."""
        f = ca.Function("f", [ca.vertcat(*symbols)], [ca.densify(ca.vertcat(*expressions))])
        given = [self._given(interval) for interval in box]
        results = evaluate(f, [given], lambda c: self._given(point(c)), self._step)
        return [bounds.interval for bounds in results]

    def factors(self) -> list[Interval]:
        """The intervals that must be finite for all products to be right."""
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
        depends = frozenset[int]().union(*[a.depends for a in arguments])
        by_a_number = op == ca.OP_MUL and any(map(rules.is_number, intervals))
        if op in _WITH_MIN_OR_MAX and not by_a_number:
            self._needed |= depends
        if op in _UNBOUNDED:
            depends = self._watch(found)
        return _Bounds(found, frozenset() if op in _BOUNDED else depends)

    def _reciprocal(self, a: _Bounds) -> _Bounds:
        """1/a, built once for all quotients with this divisor."""
        ends = a.interval.lo.element_hash(), a.interval.hi.element_hash()
        if ends not in self._reciprocals:
            # The interval is kept too: while it lives, no other expression has its hash.
            self._reciprocals[ends] = a.interval, self._step(ca.OP_INV, [a])
        return self._reciprocals[ends][1]


def _name(op: int) -> str:
    """CasADi's name of an operation, such as fmod."""
    return next(n[3:].lower() for n in vars(ca) if n.startswith("OP_") and getattr(ca, n) == op)


_RULES: Mapping[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: rules.add,
    ca.OP_SUB: rules.subtract,
    ca.OP_NEG: rules.negate,
    ca.OP_MUL: rules.multiply,
    ca.OP_INV: rules.reciprocal,
    ca.OP_SQ: rules.square,
    ca.OP_TWICE: lambda a: rules.add(a, a),
    ca.OP_SQRT: rules.above_zero(ca.sqrt),
    ca.OP_EXP: rules.exponential,
    ca.OP_LOG: rules.above_zero(ca.log),
    ca.OP_SIGN: rules.stepping(ca.sign),
    ca.OP_FLOOR: rules.stepping(ca.floor),
    ca.OP_CEIL: rules.stepping(ca.ceil),
    ca.OP_SINH: rules.increasing(ca.sinh),
    ca.OP_TANH: rules.increasing(ca.tanh),
    ca.OP_ASINH: rules.increasing(ca.asinh),
    ca.OP_ATAN: rules.increasing(ca.atan),
    ca.OP_ATAN2: rules.angle,
    ca.OP_TAN: rules.tangent,
    ca.OP_LT: lambda a, b: rules.truth(a.hi < b.lo, a.lo >= b.hi),
    ca.OP_LE: lambda a, b: rules.truth(a.hi <= b.lo, a.lo > b.hi),
    ca.OP_EQ: rules.equal,
    ca.OP_NE: lambda a, b: rules.logical_not(rules.equal(a, b)),
    ca.OP_NOT: rules.logical_not,
    ca.OP_AND: rules.logical_and,
    ca.OP_OR: lambda a, b: rules.logical_not(
        rules.logical_and(rules.logical_not(a), rules.logical_not(b))
    ),
    ca.OP_IF_ELSE_ZERO: rules.if_else_zero,
    ca.OP_SIN: rules.sine,
    ca.OP_COS: rules.cosine,
    ca.OP_FABS: rules.absolute,
    ca.OP_CONSTPOW: rules.power,
    ca.OP_POW: rules.power,
    ca.OP_FMAX: lambda a, b: Interval(ca.fmax(a.lo, b.lo), ca.fmax(a.hi, b.hi)),
    ca.OP_FMIN: lambda a, b: Interval(ca.fmin(a.lo, b.lo), ca.fmin(a.hi, b.hi)),
}

_CONTINUOUS: Mapping[int, Callable[..., ca.SX]] = {
    ca.OP_SIGN: rules.one_sign,
    ca.OP_FLOOR: rules.steps(ca.floor),
    ca.OP_CEIL: rules.steps(ca.ceil),
    ca.OP_ATAN2: rules.avoids_branch_cut,
    ca.OP_TAN: rules.one_branch,
    ca.OP_LT: lambda a, b: rules.one_sign(rules.subtract(a, b)),
    ca.OP_LE: lambda a, b: rules.one_sign(rules.subtract(a, b)),
    ca.OP_EQ: lambda a, b: rules.one_sign(rules.subtract(a, b)),
    ca.OP_NE: lambda a, b: rules.one_sign(rules.subtract(a, b)),
    ca.OP_NOT: rules.one_sign,
    ca.OP_AND: lambda a, b: ca.logic_and(rules.one_sign(a), rules.one_sign(b)),
    ca.OP_OR: lambda a, b: ca.logic_and(rules.one_sign(a), rules.one_sign(b)),
    ca.OP_IF_ELSE_ZERO: lambda condition, _: rules.one_sign(condition),
    ca.OP_INV: rules.without_zero,
    ca.OP_LOG: lambda a: a.lo > 0,
    ca.OP_SQRT: lambda a: a.lo >= 0,
    ca.OP_POW: rules.power_is_continuous,
    ca.OP_CONSTPOW: rules.power_is_continuous,
}

_WITH_MIN_OR_MAX = {
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
"""Operations whose rules take min or max, which ignore NaN."""

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
"""Operations that may be infinite where their arguments are finite."""

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
"""Operations that are finite for any arguments."""
