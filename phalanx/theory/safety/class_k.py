"""Extended class-K∞ functions α_k: increasing through zero, on the whole real line."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from annotated_types import Ge, Gt

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.extension import continuous
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError
from phalanx.theory.expressions.user_methods import MistakenMethodError, declare_scalar

_SCALES = np.geomspace(1e-9, 1e9, 73)
"""|s| at which α is evaluated, on both sides of 0."""
_NO_JUMP = 1e-9
"""A step counts as a jump above this share of the rise of α from one scale to the next."""
_HALVINGS, _MOST_PLACES = 100, 400
"""Bisections of a suspected jump, and the number of intervals kept at once."""


@runtime_checkable
class ClassK(Protocol):
    """α as a CasADi expression; a scenario names it ``package.module:Name``.

    >>> class Cubic:
    ...     def value(self, s):
    ...         return s**3
    >>> isinstance(Cubic(), ClassK)
    True
    """

    def value(self, s: ca.SX) -> ca.SX:
        """α(s), scalar, for any s, negative too."""


declare_scalar(ClassK, "value", lambda s: [s])


@dataclass(frozen=True)
class Linear:
    """α(s) = gain s; a scenario writes the bare number.

    >>> Linear(gain=2.0).value(-3.0)
    -6.0
    """

    gain: Annotated[float, Gt(0)]
    """[1/s]"""

    def value(self, s: ca.SX) -> ca.SX:
        return self.gain * s


@dataclass(frozen=True)
class Power:
    """α(s) = gain sign(s) |s|^exponent.

    Locally Lipschitz for exponents from 1 on. α_1 ... α_{q-1} are differentiated, so that
    Assumption (psiLC) requires an exponent of 1, or of 2 and more, for them.

    >>> Power(gain=2.0, exponent=2.0).value(ca.DM(-3))
    DM(-18)
    """

    gain: Annotated[float, Gt(0)]
    exponent: Annotated[float, Ge(1)]

    def value(self, s: ca.SX) -> ca.SX:
        return self.gain * ca.sign(s) * ca.fabs(s) ** self.exponent


def require_class_k(alpha: ClassK) -> None:
    """Raise MistakenMethodError unless α(0) = 0, and α increases strictly and without a jump.

    α is evaluated from 1e-9 to 1e9 on both sides of 0. Intervals in which an operation can jump, by
    extension.continuous, are bisected until α proves to jump there or not.

    Raises:
        MistakenMethodError: it is not, or an operation has no interval rule: its jumps would be
            missed.
    """
    s, end = ca.SX.sym("s"), ca.SX.sym("end")
    value = ca.SX(alpha.value(s))
    at = _pointwise([s], value)
    try:
        jumps = continuous([value], [s], [Interval(s, end)])
    except UnboundedOperationError as error:
        expected = "an expression that can be checked to be class K"
        raise MistakenMethodError(alpha, "value", expected, str(error)) from error
    cannot_jump = _pointwise([s, end], jumps)
    (zero,) = at(np.zeros(1)).tolist()
    if zero != 0.0:
        raise _mistaken(alpha, "α(0) = 0", zero)
    points = np.concatenate([-_SCALES[::-1], [0.0], _SCALES])
    # Infinite values cannot be compared.
    points = points[~np.isinf(at(points))]
    low, high = points[:-1], points[1:]
    rise = at(high) - at(low)
    # The negation catches NaN too.
    for k in np.flatnonzero(~(rise > 0.0))[:1]:
        values = tuple(at(points[k : k + 2]).tolist())
        raise _mistaken(alpha, f"α({low[k]:.3g}) < α({high[k]:.3g})", values)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
        rise = np.tile(rise, 2)
        suspect = (low < high) & (cannot_jump(low, high) == 0.0)
        low, high, rise = low[suspect], high[suspect], rise[suspect]
        if not len(low):
            return
        steepest = np.argsort(-np.abs(at(high) - at(low)))[:_MOST_PLACES]
        low, high, rise = low[steepest], high[steepest], rise[steepest]
    for k in np.flatnonzero(~(np.abs(at(high) - at(low)) <= _NO_JUMP * rise))[:1]:
        values = tuple(at(np.array([low[k], high[k]])).tolist())
        point = min(low[k], high[k], key=abs)
        raise _mistaken(alpha, f"α without a jump at {point:.6g}", values)


def _mistaken(alpha: ClassK, expected: str, got: object) -> MistakenMethodError:
    return MistakenMethodError(alpha, "value", f"{expected}, as class K has it", repr(got))


def _pointwise(symbols: list[ca.SX], value: ca.SX) -> Callable[..., Array]:
    function = ca.Function("f", symbols, [value])
    return lambda *columns: np.array(function(*[column[None] for column in columns]))[0]
