"""Interval extension of CasADi expressions: bounds over a box, themselves expressions.

The bounds are compiled like everything else, so that a control step can afford them. They are
exact up to rounding for each operation, and conservative where a variable occurs twice.
"""

from collections.abc import Callable, Mapping, Sequence

import casadi as ca

from phalanx.theory.expressions.interval import (
    Interval,
    UnboundedOperationError,
    above_zero,
    absolute,
    add,
    angle,
    beside_the_cut,
    cosine,
    equal,
    if_else_zero,
    increasing,
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
    steps,
    subtract,
    tangent,
    truth,
    truth_of,
    without_zero,
)


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


_RULES: Mapping[int, Callable[..., Interval]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: add,
    ca.OP_SUB: subtract,
    ca.OP_NEG: negate,
    ca.OP_MUL: multiply,
    ca.OP_DIV: lambda a, b: multiply(a, reciprocal(b)),
    ca.OP_INV: reciprocal,
    ca.OP_SQ: square,
    ca.OP_TWICE: lambda a: add(a, a),
    ca.OP_SQRT: above_zero(ca.sqrt),
    ca.OP_EXP: increasing(ca.exp),
    ca.OP_LOG: above_zero(ca.log),
    ca.OP_SIGN: increasing(ca.sign),
    ca.OP_FLOOR: increasing(ca.floor),
    ca.OP_CEIL: increasing(ca.ceil),
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
    ca.OP_AND: lambda a, b: multiply(truth_of(a), truth_of(b)),
    ca.OP_OR: lambda a, b: logical_not(multiply(logical_not(a), logical_not(b))),
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
    ca.OP_DIV: lambda _, b: without_zero(b),
    ca.OP_INV: without_zero,
    ca.OP_LOG: lambda a: a.lo > 0,
    ca.OP_SQRT: lambda a: a.lo >= 0,
    ca.OP_POW: power_is_continuous,
    ca.OP_CONSTPOW: power_is_continuous,
}
