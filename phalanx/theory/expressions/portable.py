"""The same function on any CPU: libm's part of an expression replaced by exact operations.

libm picks a variant of sin, exp, pow and others by what the CPU can do (FMA or not), and variants
differ in the last bit; so trajectories would. What CasADi does itself is exact: IEEE 754 fixes it.
erf and its inverse alone are left as they are.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any, NamedTuple

import casadi as ca

from phalanx.theory.expressions import circular, exponential

_PORTABLE: Mapping[int, Callable[..., Any]] = {
    ca.OP_TAN: circular.tan,
    ca.OP_ASIN: circular.asin,
    ca.OP_ACOS: circular.acos,
    ca.OP_ATAN: circular.atan,
    ca.OP_EXP: exponential.exp,
    ca.OP_LOG: exponential.log,
    ca.OP_EXPM1: exponential.expm1,
    ca.OP_LOG1P: exponential.log1p,
    ca.OP_SINH: exponential.sinh,
    ca.OP_COSH: exponential.cosh,
    ca.OP_TANH: exponential.tanh,
    ca.OP_ASINH: exponential.asinh,
    ca.OP_ACOSH: exponential.acosh,
    ca.OP_ATANH: exponential.atanh,
}
_PORTABLE_OF_TWO: Mapping[int, Callable[..., Any]] = {
    ca.OP_ATAN2: circular.atan2,
    ca.OP_HYPOT: exponential.hypot,
    ca.OP_POW: exponential.power,
    ca.OP_CONSTPOW: exponential.power,
}


_CIRCULAR = (ca.OP_SIN, ca.OP_COS)
DEAR = {*_CIRCULAR, *_PORTABLE, *_PORTABLE_OF_TWO}
"""Operations that are replaced, each by forty others or so."""


def portable_function(inputs: Sequence[ca.SX], output: ca.SX) -> ca.Function:
    """The function of column vectors to a dense column, of exact operations only."""
    function = ca.Function("f", list(inputs), [output], {"cse": True})
    operations = [function.instruction_id(k) for k in range(function.n_instructions())]
    if DEAR.isdisjoint(operations):
        return function
    with as_written():
        return ca.Function("f", *_rewritten(function, operations, inputs))


def portable_value(function: Callable[[Any], Any], x: float) -> float:
    """The value of one of `circular`'s or `exponential`'s functions at a number."""
    return float(function(ca.DM(x)))


@contextmanager
def as_written() -> Iterator[None]:
    """Keeps CasADi from simplifying: to it (a + b) - a is b, which rounding makes untrue."""
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


def _rewritten(
    function: ca.Function, operations: Sequence[int], inputs: Sequence[ca.SX]
) -> tuple[list[ca.SX], list[ca.SX]]:
    """The inputs and the output of the function, instruction by instruction."""
    work: dict[int, ca.SX] = {}
    scalars = [ca.vertsplit(column) for column in inputs]
    results = [ca.SX(0)] * function.numel_out(0)
    circles: dict[int, tuple[ca.SX, ca.SX]] = {}
    for k, op in enumerate(operations):
        sources, targets = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_CONST:
            work[targets[0]] = ca.SX(function.instruction_constant(k))
        elif op == ca.OP_INPUT:
            work[targets[0]] = scalars[sources[0]][sources[1]]
        elif op == ca.OP_OUTPUT:
            results[targets[1]] = work[sources[0]]
        elif op in _CIRCULAR:
            angle = work[sources[0]]
            place = angle.element_hash()
            if place not in circles:
                # The angle is kept too: while it lives, nothing else has its hash.
                circles[place] = angle, _sin_and_cos()(angle)
            work[targets[0]] = circles[place][1][_CIRCULAR.index(op)]
        else:
            work[targets[0]] = _apply(op, [work[s] for s in sources])
    return list(inputs), [ca.vertcat(*results)]


def _apply(op: int, arguments: Sequence[ca.SX]) -> ca.SX:
    if op in _PORTABLE:
        return ca.SX(_inlined(op)(*arguments))
    if op in _PORTABLE_OF_TWO:
        return ca.SX(_PORTABLE_OF_TWO[op](*arguments))
    if len(arguments) == 1:
        return ca.SX.unary(op, *arguments)
    return ca.SX.binary(op, *arguments)


@cache
def _sin_and_cos() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("circle", [x], [ca.vertcat(*circular.sin_and_cos(x))], {"cse": True})


@cache
def _inlined(op: int) -> ca.Function:
    """As a CasADi function, which writes out its forty instructions faster than Python can."""
    x = ca.SX.sym("x")
    return ca.Function("portable", [x], [_PORTABLE[op](x)], {"cse": True})


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
