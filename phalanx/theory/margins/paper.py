"""The sampled-data margin η(Γ), Eqs. (epsT) and (mainetadef)."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge

from phalanx.theory.expressions.exponential import expm1
from phalanx.theory.expressions.portable import portable_value

NonNegative = Annotated[float, Ge(0)]


def epsilon(gamma: float, mu: float, lipschitz: float = 0.0) -> float:
    """ε(Γ) = μ/L' (exp(L' Γ) - 1), Eq. (epsT): how far x moves within Γ seconds.

    Args:
        gamma: time since the sample [s].
        mu: bound on ‖x'‖ over the safe set.
        lipschitz: L' > 0, any; its limit 0 gives the tightest bound, μ Γ.
    """
    if lipschitz == 0.0:
        return mu * gamma
    return mu / lipschitz * portable_value(expm1, lipschitz * gamma)


@dataclass(frozen=True)
class MarginConstants:
    """The constants of Lemma (constants) and Lemma (xdiffbound), from which η follows."""

    c_f: NonNegative
    c_g: NonNegative
    c_alpha: NonNegative
    c_gamma: NonNegative
    c_h: NonNegative
    u_max: NonNegative
    mu: NonNegative

    def eta(self, gamma: float, disturbances: float) -> float:
        """η(Γ), Eq. (mainetadef).

        Args:
            gamma: longest time between samples, Γ_i + δ^max [s].
            disturbances: Σ_l φ_l^max.
        """
        rate = self.c_f + self.c_g * self.u_max + self.c_alpha + self.c_gamma
        return rate * epsilon(gamma, self.mu) + self.c_h * disturbances
