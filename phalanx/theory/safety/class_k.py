"""Extended class-K∞ functions α_k: increasing through zero, on the whole real line."""

from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import casadi as ca
from annotated_types import Ge, Gt


@runtime_checkable
class ClassK(Protocol):
    """α as a CasADi expression; a scenario names it ``package.module:Name``."""

    def value(self, s: ca.SX) -> ca.SX:
        """α(s), scalar, for any s, negative too."""


@dataclass(frozen=True)
class Linear:
    """α(s) = gain s; a scenario writes the bare number."""

    gain: Annotated[float, Gt(0)]
    """[1/s]"""

    def value(self, s: ca.SX) -> ca.SX:
        return self.gain * s


@dataclass(frozen=True)
class Power:
    """α(s) = gain sign(s) |s|^exponent.

    Locally Lipschitz for exponents from 1 on. α_1 ... α_{q-1} are differentiated, so that
    Assumption (psiLC) asks for 1, or 2 and more, of them.
    """

    gain: Annotated[float, Gt(0)]
    exponent: Annotated[float, Ge(1)]

    def value(self, s: ca.SX) -> ca.SX:
        return self.gain * ca.sign(s) * ca.fabs(s) ** self.exponent
