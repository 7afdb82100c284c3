"""Which way the ends of intervals are rounded: to nearest, or outwards where a proof rests on them.

Rows take the nearest: their margins are part of every trajectory, and leave 1e-5 to solvers and
actuators, far more than rounding takes. Certificates take no end that could be on the wrong side.
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
"""Added to a number, as a share of it, at least one float64 and less than two of them."""
LEAST = 2.0**-1022
"""The smallest normal number: what is below may have been lost, or made from what was infinite."""


@contextmanager
def outwards() -> Iterator[None]:
    """Round ends outwards in every expression that is built within."""
    token = _outwards.set(True)
    try:
        yield
    finally:
        _outwards.reset(token)


def rounds_outwards() -> bool:
    """Whether ends are rounded outwards now."""
    return _outwards.get()


def doubt(value: ca.SX, steps: int, least: float) -> ca.SX:
    """More than a computed value may be off by: that many float64, and at least so much.

    Rounded to nearest a value is off by at most half of the distance to the next float64, and
    value ± |value| 2^-52, rounded itself, is at least that next one. A lower end that overflowed,
    inf, is then not a number, which no comparison takes for proven; likewise an upper one, -inf.
    """
    share = _times(_number(steps * _STEP), ca.SX.unary(ca.OP_FABS, value))
    return _plus(share, _number(least)) if least else share


@cache
def _number(value: float) -> ca.SX:
    """Made once: that takes longer than what is done with it."""
    return ca.SX(value)
