"""The sampled-data margin η(Γ), Eqs. (epsT) and (mainetadef), and its constants over a box.

They are those of Lemmas (constants), (psiconstants) and (xdiffbound). S as the paper gives it is
not compact, so a box is needed. A Lipschitz constant is the largest gradient norm over the box:
proven by interval arithmetic where that gives a finite bound, else estimated by the largest of many
samples of S_I.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import casadi as ca
import numpy as np
from annotated_types import Ge

from phalanx.arrays import Array
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError
from phalanx.theory.models.polytope import Polytope, constant_polytope
from phalanx.theory.safety.chain import Chain

NonNegative = Annotated[float, Ge(0)]


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
        # ε(Γ) = μ/L' (exp(L' Γ) - 1), Eq. (epsT), for any L' > 0: its limit at 0 is the tightest.
        return rate * (self.mu * gamma) + self.c_h * disturbances


_MOST_INSTRUCTIONS = 4000
"""Larger expressions are sampled, since an interval extension would take too long."""
_USELESS = 1e9
"""An interval bound above this is too wide to use."""


class Constant(NamedTuple):
    """One constant and its method."""

    value: float
    how: Literal["interval", "sampled"]
    """Proven by interval arithmetic, or the largest value of samples: a lower estimate."""


def constants(
    chain: Chain, low: Array, high: Array, bounds: Sequence[float], samples: Array
) -> dict[str, Constant]:
    """c_f, c_g, c_alpha, c_gamma, c_h, u_max and mu.

    Args:
        chain: of h_tot.
        low: least values of the stacked state in the workspace box, shape (n̄,).
        high: the largest.
        bounds: φ_l^max of each member.
        samples: states in S_I for constants without an interval bound, shape (s, n̄).

    Raises:
        ValueError: a member's input polytope depends on its state.
    """
    polytopes = _polytopes(chain)
    expressions = _norms(chain, polytopes, bounds)
    composed = chain.set
    normal = [l for l, m in enumerate(composed.members) if not m.adversary]
    largest_input = max(float(np.linalg.norm(polytopes[l].corners, axis=1).max()) for l in normal)
    found = {"u_max": Constant(largest_input, "interval")}
    smooth = _smooth(chain, low, high)
    for name, expression in expressions.items():
        bound = _by_interval(chain, expression, low, high) if smooth else None
        found[name] = bound or _by_samples(chain, expression, samples)
    return found


def margin_constants(found: Mapping[str, Constant]) -> MarginConstants:
    """The constants for Eq. (mainetadef)."""
    return MarginConstants(**{name: constant.value for name, constant in found.items()})


def _norms(
    chain: Chain, polytopes: Sequence[Polytope], bounds: Sequence[float]
) -> dict[str, ca.SX]:
    """The gradient norms whose suprema are the constants, scalars."""
    composed, x, members = chain.set, chain.set.x, chain.set.members
    c_f, c_g, c_gamma, speed = ca.SX(0), ca.SX(0), ca.SX(0), ca.SX(0)
    c_h = []
    for l, (member, part) in enumerate(zip(members, composed.parts, strict=True)):
        drift = ca.jacobian(chain.drift[l], x)
        actuation = ca.jacobian(chain.actuation[l].T, x)
        if member.adversary:
            corners = [ca.DM(v).T @ actuation + drift for v in polytopes[l].corners]
            c_gamma += ca.mmax(ca.vertcat(*[_norm(c) for c in corners]))
        else:
            c_f += _norm(drift)
            c_g += _norm(actuation)
        own = x[part]
        rates = [
            member.dynamics.drift(own) + member.dynamics.actuation(own) @ ca.DM(v)
            for v in polytopes[l].corners
        ]
        fastest = ca.mmax(ca.vertcat(*[_norm(r) for r in rates])) + bounds[l]
        speed += fastest**2
        c_h.append(_norm(ca.jacobian(chain.psi[-1], own)))
    return {
        "c_f": c_f,
        "c_g": c_g,
        "c_alpha": _norm(ca.jacobian(chain.alpha, x)),
        "c_gamma": c_gamma,
        "c_h": ca.mmax(ca.vertcat(*c_h)),
        "mu": ca.sqrt(speed),
    }


def _norm(matrix: ca.SX) -> ca.SX:
    return ca.sqrt(ca.sumsqr(matrix))


def _smooth(chain: Chain, low: Array, high: Array) -> bool:
    """Return whether h has no kink in the box, so that gradients bound differences."""
    parts = ca.vertcat(*map(ca.vec, chain.actuation), chain.drift)
    settled, x = chain.set.substitute(parts), chain.set.x
    try:
        return bool(continuous(ca.vertsplit(settled), ca.vertsplit(x), _box(low, high)))
    except UnboundedOperationError:
        return False


def _box(low: Array, high: Array) -> list[Interval]:
    return [Interval(ca.SX(a), ca.SX(b)) for a, b in zip(low.tolist(), high.tolist(), strict=True)]


def _by_interval(chain: Chain, expression: ca.SX, low: Array, high: Array) -> Constant | None:
    settled, x = chain.set.substitute(expression), chain.set.x
    function = ca.Function("size", [x], [settled])
    if function.n_instructions() > _MOST_INSTRUCTIONS:
        return None
    try:
        (bound,) = extend([settled], ca.vertsplit(x), _box(low, high))
    except UnboundedOperationError:
        return None
    value = float(bound.hi)
    return Constant(value, "interval") if np.isfinite(value) and value < _USELESS else None


def _by_samples(chain: Chain, expression: ca.SX, samples: Array) -> Constant:
    function = ca.Function("c", [chain.set.x], [chain.set.substitute(expression)])
    values = np.array(function.map(len(samples))(samples.T))[0]
    return Constant(float(np.nanmax(values)), "sampled")


def _polytopes(chain: Chain) -> list[Polytope]:
    found = []
    for member, part in zip(chain.set.members, chain.set.parts, strict=True):
        known = constant_polytope(*member.dynamics.input_polytope(chain.set.x[part]))
        if known is None:
            raise ValueError(f"expected constant input bounds of {member.name}")
        found.append(known)
    return found
