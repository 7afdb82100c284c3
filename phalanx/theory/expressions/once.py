"""What of an expression depends on one of its arguments alone, taken out to be evaluated once."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca

from phalanx.theory.expressions.portable import DEAR


class TakenOut(NamedTuple):
    """An expression in two steps."""

    parts: list[ca.SX]
    """Of each argument alone, shapes (k,), which may be empty."""
    symbols: list[ca.SX]
    """Symbols in their place, of the same shapes."""
    rest: ca.SX
    """Of arguments and symbols."""


class _Value(NamedTuple):
    """One step of an expression."""

    whole: ca.SX
    rest: ca.SX
    of: frozenset[int]
    """Which arguments it is made of."""


def take_out(arguments: Sequence[ca.SX], others: ca.SX, expression: ca.SX) -> TakenOut:
    """Take sines, exponentials and the like out where they are of one argument alone.

    Args:
        arguments: columns of symbols, shapes (n_l,).
        others: further symbols of the expression, shape (k,).
        expression: of any shape, which the rest has too.
    """
    every = [*arguments, others]
    f = ca.Function("f", every, [ca.densify(expression)], {"cse": True})
    taken: list[list[_Value]] = [[] for _ in arguments]
    work: dict[int, _Value] = {}
    rest = ca.SX.zeros(f.numel_out(0))
    for k in range(f.n_instructions()):
        op, sources, targets = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if op == ca.OP_CONST:
            number = ca.SX(f.instruction_constant(k))
            work[targets[0]] = _Value(number, number, frozenset())
        elif op == ca.OP_INPUT:
            symbol = every[sources[0]][sources[1]]
            work[targets[0]] = _Value(symbol, symbol, frozenset(sources[:1]))
        elif op == ca.OP_OUTPUT:
            rest[targets[1]] = work[sources[0]].rest
        else:
            found = _step(op, [work[s] for s in sources])
            own = min(found.of, default=0)
            if op in DEAR and found.of == {own} and own < len(arguments):
                found = found._replace(rest=ca.SX.sym("once"))
                taken[own].append(found)
            work[targets[0]] = found
    parts = [ca.vertcat(*[value.whole for value in own]) for own in taken]
    symbols = [ca.vertcat(*[value.rest for value in own]) for own in taken]
    return TakenOut(parts, symbols, ca.reshape(rest, *expression.shape))


def _step(op: int, values: Sequence[_Value]) -> _Value:
    apply = ca.SX.unary if len(values) == 1 else ca.SX.binary
    whole, rest = apply(op, *[v.whole for v in values]), apply(op, *[v.rest for v in values])
    return _Value(whole, rest, frozenset[int]().union(*[v.of for v in values]))
