"""Operations of CasADi with their true values, to any precision, and boxes to try them on."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import mpmath
from hypothesis import strategies as st

mpmath.mp.prec = 160
Number = Any
"""mpmath's."""


@dataclass(frozen=True)
class Operation:
    build: Callable[..., ca.SX]
    truly: Callable[..., Number]
    arguments: int = 1


def _power(exponent: float) -> Operation:
    return Operation(lambda x: x**exponent, lambda x: mpmath.power(x, mpmath.mpf(exponent)))


OPERATIONS: dict[str, Operation] = {
    "add": Operation(lambda x, y: x + y, lambda x, y: x + y, 2),
    "subtract": Operation(lambda x, y: x - y, lambda x, y: x - y, 2),
    "multiply": Operation(lambda x, y: x * y, lambda x, y: x * y, 2),
    "divide": Operation(lambda x, y: x / y, lambda x, y: x / y, 2),
    "fmin": Operation(ca.fmin, min, 2),
    "fmax": Operation(ca.fmax, max, 2),
    "atan2": Operation(ca.atan2, lambda y, x: mpmath.atan2(y, x), 2),
    "difference of squares": Operation(lambda x, y: x * x - y * y, lambda x, y: x * x - y * y, 2),
    "norm": Operation(
        lambda x, y: ca.norm_2(ca.vertcat(x, y)), lambda x, y: mpmath.sqrt(x * x + y * y), 2
    ),
    "larger difference": Operation(
        lambda x, y: ca.fmax(x * x - y * y, -5.0), lambda x, y: max(x * x - y * y, -5), 2
    ),
    "by a number": Operation(lambda x: 0.1 * x, lambda x: mpmath.mpf(0.1) * x),
    "by a half": Operation(lambda x: 0.5 * x, lambda x: x / 2),
    "negate": Operation(lambda x: -x, lambda x: -x),
    "twice": Operation(lambda x: 2 * x, lambda x: 2 * x),
    "invert": Operation(lambda x: 1 / x, lambda x: 1 / x),
    "square": Operation(lambda x: x * x, lambda x: x * x),
    "fabs": Operation(ca.fabs, abs),
    "sign": Operation(ca.sign, mpmath.sign),
    "floor": Operation(ca.floor, mpmath.floor),
    "ceil": Operation(ca.ceil, mpmath.ceil),
    "sqrt": Operation(ca.sqrt, mpmath.sqrt),
    "exp": Operation(ca.exp, mpmath.exp),
    "log": Operation(ca.log, mpmath.log),
    "sin": Operation(ca.sin, mpmath.sin),
    "cos": Operation(ca.cos, mpmath.cos),
    "tan": Operation(ca.tan, mpmath.tan),
    "asin": Operation(ca.asin, mpmath.asin),
    "acos": Operation(ca.acos, mpmath.acos),
    "atan": Operation(ca.atan, mpmath.atan),
    "sinh": Operation(ca.sinh, mpmath.sinh),
    "cosh": Operation(ca.cosh, mpmath.cosh),
    "tanh": Operation(ca.tanh, mpmath.tanh),
    "asinh": Operation(ca.asinh, mpmath.asinh),
    "to the 3": _power(3.0),
    "to the 5": _power(5.0),
    "to the 40": _power(40.0),
    "to the -1": _power(-1.0),
    "to the -3": _power(-3.0),
    "to the -4": _power(-4.0),
    "to the -7": _power(-7.0),
    "to the 1.5": _power(1.5),
    "to the 2.7": _power(2.7),
    "to the -0.3": _power(-0.3),
}

_HALF_PI = math.pi / 2
_SIZES = [0.0, 5e-324, 1e-310, 2.3e-308, 1e-200, 1e-160, 1e-9, 0.5, 1.0, 0.9999999999999999, 700.0]
_SIZES += [745.0, 1e5, 99999.5, 1e8, 1e15, 1e22, 1e154, 1.4e154, 1e200, 1.7e308]
_turns = st.integers(-70000, 70000) | st.integers(-9, 9)
_near_turns = st.builds(lambda k, n: _moved(k * _HALF_PI, n), _turns, st.integers(-3, 3))
ends = (
    st.floats(-8.0, 8.0)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.sampled_from([*_SIZES, *[-size for size in _SIZES]])
    | _near_turns
)
_widths = st.sampled_from([0.0, 1e-300, 1e-15, 1e-12, 1e-3, 1e200]) | st.floats(0.0, 8.0)


def _moved(number: float, steps: int) -> float:
    for _ in range(abs(steps)):
        number = math.nextafter(number, math.copysign(math.inf, steps))
    return number


def _box(low: float, width: float, steps: int) -> tuple[float, float]:
    high = low + width
    return low, _moved(low, steps) if width == 0.0 or not math.isfinite(high) else high


boxes = st.builds(_box, ends, _widths, st.integers(0, 3))


def within(box: tuple[float, float], share: float) -> list[Number]:
    """Numbers in a box: its ends, one that lies so far between them, and where waves turn."""
    low, high = map(mpmath.mpf, box)
    numbers = [low, high, min(high, max(low, low + mpmath.mpf(share) * (high - low)))]
    half_pi = mpmath.pi / 2
    for turn in (mpmath.ceil(low / half_pi), mpmath.ceil(low / half_pi) + 1, mpmath.mpf(0)):
        if low <= turn * half_pi <= high:
            numbers.append(turn * half_pi)
    return numbers


def true_value(operation: Operation, x: Number, y: Number | None) -> Number:
    """The function of one number or two; NaN where it is undefined."""
    try:
        return operation.truly(*([x] if operation.arguments == 1 else [x, y]))
    except (ZeroDivisionError, ValueError):
        return mpmath.nan


def is_held(low: float, truth: Number, high: float) -> bool:
    """Return whether a true value lies within the bounds; True where it is undefined."""
    if isinstance(truth, mpmath.mpc) or not mpmath.isfinite(truth):
        return True
    return bool(mpmath.mpf(low) <= truth <= mpmath.mpf(high))
