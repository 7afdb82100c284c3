"""Safe-set functions h of two agents, or of an agent and an obstacle; safe is h <= 0.

The functions here have a proven reach, so that distant pairs can be left out.
"""

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca

from phalanx.theory.expressions.rounding import WIDER
from phalanx.theory.models.dynamics import Positive
from phalanx.theory.safety.obstacles import Obstacle


@dataclass(frozen=True)
class Body:
    """One agent as an argument of a safe-set function."""

    x: ca.SX
    """State, shape (n,)."""
    p: ca.SX
    """Output position [m], shape (2,) or (3,)."""
    states: tuple[str, ...] = ()
    """Names of its dynamics' states, shape (n,)."""
    adversary: bool = False


@runtime_checkable
class SafeSetFunction(Protocol):
    """h as CasADi expressions; a scenario names it ``package.module:Name``."""

    def between(self, a: Body, b: Body) -> ca.SX:
        """h_ab, scalar, of a normal agent a and any other agent b."""

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        """h of a normal agent a and an obstacle, scalar.

        Called first with a sphere of symbols, for one expression that serves all spheres. If that
        raises, or gives another h than numbers do, every sphere has an expression of its own.
        """


@dataclass(frozen=True)
class Separation:
    """h = R² - ‖p_a - p_b‖²: the output points stay R apart."""

    radius: Positive
    """R between agents [m]; R_c + 2b in the paper's Simulation 1."""
    unit = "m²"

    def between(self, a: Body, b: Body) -> ca.SX:
        return self.radius * self.radius - ca.sumsqr(a.p - b.p)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.intrusion(a.p)

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        if obstacle is not None:
            return obstacle.reach(level)
        return math.sqrt(self.radius * self.radius - level) * WIDER


@dataclass(frozen=True)
class Distance:
    """h = R - ‖p_a - p_b‖: the same safe set as R² - ‖p_a - p_b‖², with a gradient of one length.

    Far away the disturbance costs h no more than nearby, so that a weak α_1 can pay for it.
    Smooth except where two output points meet.
    """

    radius: Positive
    """R between agents [m]."""
    unit = "m"

    def between(self, a: Body, b: Body) -> ca.SX:
        return self.radius - ca.norm_2(a.p - b.p)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.clearance - obstacle.distance(a.p)

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        return ((self.radius if obstacle is None else obstacle.clearance) - level) * WIDER


@dataclass(frozen=True)
class HeadingAware:
    """h = R + κ (1 - cos γ) - d for unicycles: farther apart, the less a heading points away.

    γ is the angle between a normal agent's heading and the direction away from the other; for two
    normal agents cos γ is the mean of both, so that each can keep its half. Side-on a unicycle can
    hardly change d, but turning changes h: ∂h/∂θ is κ. Along the line of sight driving changes d at
    full speed, forwards or backwards. With sin² γ, the same both ways, turning would change nothing
    side-on; so only headings away from the other lower h. Smooth except where d = 0.
    """

    radius: Positive
    """R between agents [m], with headings straight away from the other."""
    kappa: Positive
    """κ [m]: additional distance when side-on; twice that head-on."""
    unit = "m"

    def between(self, a: Body, b: Body) -> ca.SX:
        apart = ca.norm_2(a.p - b.p)
        away = (a.p - b.p) / apart
        cosine = _heading(a, away)
        if not b.adversary:
            cosine = (cosine + _heading(b, -away)) / 2
        return self.radius + self.kappa * (1 - cosine) - apart

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        cosine = _heading(a, obstacle.away(a.p))
        return obstacle.clearance + self.kappa * (1 - cosine) - obstacle.distance(a.p)

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        keep_out = self.radius if obstacle is None else obstacle.clearance
        return (keep_out + 2.0 * self.kappa - level) * WIDER


def _heading(body: Body, away: ca.SX) -> ca.SX:
    """cos γ between a unicycle's heading and a direction. Raises ValueError for other dynamics."""
    if body.states != ("x", "y", "theta"):
        raise ValueError(
            "safety.function: heading-aware needs normal agents that are unicycles, with states "
            f"x, y, theta; got {', '.join(body.states)}"
        )
    return ca.dot(ca.vertcat(ca.cos(body.x[2]), ca.sin(body.x[2])), away)


_PROVEN = (Separation, Distance, HeadingAware)
_METHODS = ("between", "to_obstacle", "reach")


class Reaching(Protocol):
    """A safe-set function with h below any level, far enough away."""

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        """Distance beyond which h is below a level <= 0 [m].

        Between the output points of any two agents; or `obstacle.distance` of an agent's.
        """


def proven_reach(function: SafeSetFunction) -> Reaching | None:
    """The function, if its h and its reach are those of a class above; None for a user's own.

    With a reach that is too short, unsafe pairs would be missing in verdict and certificates.
    """
    for known in _PROVEN:
        own = (getattr(type(function), name, None) is getattr(known, name) for name in _METHODS)
        if isinstance(function, known) and all(own):
            return function
    return None
