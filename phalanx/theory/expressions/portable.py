"""Functions with the same bits on any CPU: exact operations in place of libm's.

libm picks a variant of sin, exp, pow and others by the CPU's instructions (FMA or not), and
variants differ in the last bit; so trajectories would. CasADi's own operations are fixed by
IEEE 754. erf and its inverse alone are left as they are.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import casadi as ca

from phalanx.theory.expressions import circular, exponential
from phalanx.theory.expressions.instructions import evaluate

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
"""Expensive operations, each of which is replaced by about forty others."""


def portable_function(inputs: Sequence[ca.SX], output: ca.SX) -> ca.Function:
    """A CasADi function of columns with one dense column as output, of exact operations only."""
    function = ca.Function("f", list(inputs), [output], {"cse": True})
    if all(function.instruction_id(k) not in DEAR for k in range(function.n_instructions())):
        return function
    with as_written():
        scalars = [ca.vertsplit(column) for column in inputs]
        results = evaluate(function, scalars, ca.SX, _Replacement())
        return ca.Function("f", list(inputs), [ca.vertcat(*results)])


def portable_value(function: Callable[[Any], Any], x: float) -> float:
    """Evaluate a function of `circular` or `exponential` at a number.

    >>> from phalanx.theory.expressions.circular import atan
    >>> portable_value(atan, 1.0)
    0.7853981633974483
    """
    return float(function(ca.DM(x)))


@contextmanager
def as_written() -> Iterator[None]:
    """Keep CasADi from simplifying: it takes (a + b) - a for b, which rounding makes untrue."""
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        yield
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


class _Replacement:
    """Operations of one expression, those of libm replaced; sine and cosine share their work."""

    def __init__(self) -> None:
        self._circles: dict[int, tuple[ca.SX, ca.SX]] = {}

    def __call__(self, op: int, arguments: Sequence[ca.SX]) -> ca.SX:
        """The operation's result."""
        if op in _CIRCULAR:
            angle = arguments[0]
            key = angle.element_hash()
            if key not in self._circles:
                # The angle is kept too: while it lives, no other expression has its hash.
                self._circles[key] = angle, _sin_and_cos()(angle)
            return self._circles[key][1][_CIRCULAR.index(op)]
        if op in _PORTABLE:
            return ca.SX(_inlined(op)(*arguments))
        if op in _PORTABLE_OF_TWO:
            return ca.SX(_PORTABLE_OF_TWO[op](*arguments))
        return (ca.SX.unary if len(arguments) == 1 else ca.SX.binary)(op, *arguments)


@cache
def _sin_and_cos() -> ca.Function:
    x = ca.SX.sym("x")
    return ca.Function("circle", [x], [ca.vertcat(*circular.sin_and_cos(x))], {"cse": True})


@cache
def _inlined(op: int) -> ca.Function:
    """A replacement as a CasADi function, which is expanded faster than Python code."""
    x = ca.SX.sym("x")
    return ca.Function("portable", [x], [_PORTABLE[op](x)], {"cse": True})
