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
    bounded = rules.finite(factors)
    return [
        Interval(ca.if_else(bounded, a.lo, -ca.inf), ca.if_else(bounded, a.hi, ca.inf))
        for a in bounds
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
    smooth = rules.finite(extension.factors())
    for condition in extension.conditions:
        smooth = ca.logic_and(smooth, condition)
    return smooth


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
        inputs = [self._bounds_of(interval) for interval in box]
        results = evaluate(f, [inputs], lambda c: self._bounds_of(point(c)), self._step)
        return [bounds.interval for bounds in results]

    def factors(self) -> list[Interval]:
        """The intervals that must be finite for all products to be right."""
        return [self._watched[k] for k in sorted(self._needed)]

    def _bounds_of(self, interval: Interval) -> _Bounds:
        constant = all(end.is_constant() and math.isfinite(float(end)) for end in interval)
        return _Bounds(interval, frozenset() if constant else self._watch(interval))

    def _watch(self, interval: Interval) -> frozenset[int]:
        self._watched.append(interval)
        return frozenset([len(self._watched) - 1])

    def _step(self, op: int, arguments: Sequence[_Bounds]) -> _Bounds:
        """Raises UnboundedOperationError."""
        if op == ca.OP_DIV:
            return self._step(ca.OP_MUL, [arguments[0], self._reciprocal(arguments[1])])
        if (operation := _OPERATIONS.get(op)) is None:
            raise UnboundedOperationError(f"no interval rule for the operation {_name(op)}")
        intervals = [a.interval for a in arguments]
        if operation.continuous is not None:
            self.conditions.append(operation.continuous(*intervals))
        bounds = operation.rule(*intervals)
        depends = frozenset[int]().union(*[a.depends for a in arguments])
        by_a_number = op == ca.OP_MUL and any(map(rules.is_number, intervals))
        if operation.selects and not by_a_number:
            self._needed |= depends
        if operation.unbounded:
            depends = self._watch(bounds)
        return _Bounds(bounds, frozenset() if operation.bounded else depends)

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


class _Operation(NamedTuple):
    """An operation of CasADi on intervals."""

    rule: Callable[..., Interval]
    continuous: Callable[..., ca.SX] | None = None
    """Condition under which it cannot jump; None if it never does."""
    selects: bool = False
    """The rule takes min or max, which ignore NaN."""
    unbounded: bool = False
    """It may be infinite where its arguments are finite."""
    bounded: bool = False
    """It is finite for any arguments."""


def _same_sign(a: Interval, b: Interval) -> ca.SX:
    return rules.one_sign(rules.subtract(a, b))


def _both_one_sign(a: Interval, b: Interval) -> ca.SX:
    return ca.logic_and(rules.one_sign(a), rules.one_sign(b))


_POWER = _Operation(rules.power, rules.power_is_continuous, selects=True, unbounded=True)

_OPERATIONS: Mapping[int, _Operation] = {
    ca.OP_ASSIGN: _Operation(lambda a: a),
    ca.OP_ADD: _Operation(rules.add),
    ca.OP_SUB: _Operation(rules.subtract),
    ca.OP_NEG: _Operation(rules.negate),
    ca.OP_MUL: _Operation(rules.multiply, selects=True),
    ca.OP_INV: _Operation(rules.reciprocal, rules.without_zero, unbounded=True),
    ca.OP_SQ: _Operation(rules.square, selects=True),
    ca.OP_TWICE: _Operation(lambda a: rules.add(a, a)),
    ca.OP_SQRT: _Operation(rules.above_zero(ca.sqrt), lambda a: a.lo >= 0, unbounded=True),
    ca.OP_EXP: _Operation(rules.exponential, unbounded=True),
    ca.OP_LOG: _Operation(rules.above_zero(ca.log), lambda a: a.lo > 0, unbounded=True),
    ca.OP_SIGN: _Operation(rules.stepping(ca.sign), rules.one_sign, bounded=True),
    ca.OP_FLOOR: _Operation(rules.stepping(ca.floor), rules.steps(ca.floor)),
    ca.OP_CEIL: _Operation(rules.stepping(ca.ceil), rules.steps(ca.ceil)),
    ca.OP_SINH: _Operation(rules.increasing(ca.sinh), unbounded=True),
    ca.OP_TANH: _Operation(rules.increasing(ca.tanh), bounded=True),
    ca.OP_ASINH: _Operation(rules.increasing(ca.asinh)),
    ca.OP_ATAN: _Operation(rules.increasing(ca.atan), bounded=True),
    ca.OP_ATAN2: _Operation(rules.angle, rules.avoids_branch_cut, selects=True, bounded=True),
    ca.OP_TAN: _Operation(rules.tangent, rules.one_branch, unbounded=True),
    ca.OP_LT: _Operation(
        lambda a, b: rules.truth(a.hi < b.lo, a.lo >= b.hi), _same_sign, bounded=True
    ),
    ca.OP_LE: _Operation(
        lambda a, b: rules.truth(a.hi <= b.lo, a.lo > b.hi), _same_sign, bounded=True
    ),
    ca.OP_EQ: _Operation(rules.equal, _same_sign, bounded=True),
    ca.OP_NE: _Operation(
        lambda a, b: rules.logical_not(rules.equal(a, b)), _same_sign, bounded=True
    ),
    ca.OP_NOT: _Operation(rules.logical_not, rules.one_sign, bounded=True),
    ca.OP_AND: _Operation(rules.logical_and, _both_one_sign, bounded=True),
    ca.OP_OR: _Operation(rules.logical_or, _both_one_sign, bounded=True),
    ca.OP_IF_ELSE_ZERO: _Operation(
        rules.if_else_zero, lambda condition, _: rules.one_sign(condition), selects=True
    ),
    ca.OP_SIN: _Operation(rules.sine, bounded=True),
    ca.OP_COS: _Operation(rules.cosine, bounded=True),
    ca.OP_FABS: _Operation(rules.absolute, selects=True),
    ca.OP_CONSTPOW: _POWER,
    ca.OP_POW: _POWER,
    ca.OP_FMAX: _Operation(rules.larger, selects=True),
    ca.OP_FMIN: _Operation(rules.smaller, selects=True),
}
