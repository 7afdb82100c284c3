"""Rounding of interval ends: to nearest, or outwards where a proof needs it.

Margins of rows are rounded to nearest: they are part of every trajectory, and an allowance of 1e-5
for solvers and actuators covers rounding. Certificates round outwards.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, partial

import casadi as ca

# a + b itself looks for its overload, seven times as long.
_plus, _times = partial(ca.SX.binary, ca.OP_ADD), partial(ca.SX.binary, ca.OP_MUL)
_outwards = ContextVar("outwards", default=False)
_STEP = 2.0**-52
"""|x| times this is one to two spacings of float64 at x."""
LEAST = 2.0**-1022
"""The smallest normal number: products and quotients below it may have lost digits."""
WIDER = 1.0 + 1e-9
"""Factor that makes a distance large enough in spite of rounding."""


@contextmanager
def outwards() -> Iterator[None]:
    """Round interval ends outwards in every expression that is built in this context."""
    token = _outwards.set(True)
    try:
        yield
    finally:
        _outwards.reset(token)


def rounds_outwards() -> bool:
    """Return whether interval ends are rounded outwards in this context."""
    return _outwards.get()


def error_bound(value: ca.SX, steps: int, least: float) -> ca.SX:
    """Bound the rounding error of a computed value by |value| steps 2^-52 + least.

    Rounded to nearest a value is off by at most half of the distance to the next float64, and
    value ± |value| 2^-52, rounded itself, is at least that next one. A lower end that overflowed to
    inf becomes NaN, for which every comparison is false; likewise an upper end of -inf.
    """
    share = _times(_number(steps * _STEP), ca.SX.unary(ca.OP_FABS, value))
    return _plus(share, _number(least)) if least else share


@cache
def _number(value: float) -> ca.SX:
    """A constant, kept: to make one takes longer than to use it."""
    return ca.SX(value)
