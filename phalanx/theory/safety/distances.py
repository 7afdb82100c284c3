"""Safe-set functions in metres: the distance itself, and one that asks for room to turn."""

from dataclasses import dataclass
from typing import Annotated

import casadi as ca
from annotated_types import Gt

from phalanx.theory.safety.function import Body
from phalanx.theory.safety.obstacles import WIDER, Obstacle

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True)
class Distance:
    """h = R - ‖p_a - p_b‖: the same safe set as R² - ‖p_a - p_b‖², with a gradient of one length.

    Far away the disturbance costs h no more than nearby, so that a weak α_1 can pay for it.
    Smooth but where two output points meet.
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

    γ is the angle between a normal agent's heading and the direction that leads away from the
    other; of two normal agents cos γ is the mean of both, so that each can keep its half. Side-on a
    unicycle has next to no authority over d, but turning lowers h there: ∂h/∂θ is κ. Along the line
    of sight, whichever way it faces, driving changes d at full speed. If both ways counted as good,
    with sin² γ, turning would do nothing side-on. Away is the good one: an agent flees ahead.
    Smooth but where d = 0.
    """

    radius: Positive
    """R between agents [m], with headings straight away from the other."""
    kappa: Positive
    """κ [m]: what is asked for on top when side-on; twice that head-on."""
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
    """cos γ of a unicycle's heading and a direction. Raises ValueError for other dynamics."""
    if body.states != ("x", "y", "theta"):
        raise ValueError(
            "safety.function: heading-aware needs normal agents that are unicycles, with states "
            f"x, y, theta; got {', '.join(body.states)}"
        )
    return ca.dot(ca.vertcat(ca.cos(body.x[2]), ca.sin(body.x[2])), away)
