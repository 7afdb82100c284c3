"""Safe-set functions in metres: the distance itself, and one that asks for room to turn."""

from dataclasses import dataclass
from typing import Annotated

import casadi as ca
from annotated_types import Gt

from phalanx.theory.safety.function import Body
from phalanx.theory.safety.obstacles import Obstacle

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True)
class Distance:
    """h = R - ‖p_a - p_b‖: the same safe set as R² - ‖p_a - p_b‖², with a gradient of one length.

    Far away the disturbance costs h no more than nearby, so that a weak α_1 can pay for it.
    Smooth but where two output points meet.
    """

    radius: Positive
    """R between agents [m]."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return self.radius - ca.norm_2(a.p - b.p)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.clearance - obstacle.distance(a.p)


@dataclass(frozen=True)
class HeadingAware:
    """h = R + κ (1 - cos γ) - d for unicycles: farther apart, the less a's heading points away.

    γ is the angle between agent a's heading and the direction from the other one to a. Turning
    lowers h where driving cannot: side-on, where a unicycle has next to no authority over its
    distance d, ∂h/∂θ is κ. Along the line of sight, whichever way it faces, driving changes d at
    full speed. Had both ways counted as good, with sin² γ, turning would do nothing side-on. Away
    is the good one, for it lets an agent flee ahead. Smooth but where d = 0.
    """

    radius: Positive
    """R between agents [m], with a's heading straight away from the other."""
    kappa: Positive
    """κ [m]: what is asked for on top when side-on; twice that head-on."""

    def between(self, a: Body, b: Body) -> ca.SX:
        apart = ca.norm_2(a.p - b.p)
        return self._unsafe(self.radius, a, apart, (a.p - b.p) / apart)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        distance = obstacle.distance(a.p)
        return self._unsafe(obstacle.clearance, a, distance, obstacle.away(a.p))

    def _unsafe(self, clearance: float, a: Body, distance: ca.SX, away: ca.SX) -> ca.SX:
        """h, given the distance and the direction in which it grows.

        Raises ValueError for other dynamics than a unicycle's.
        """
        if a.states != ("x", "y", "theta"):
            got = ", ".join(a.states)
            raise ValueError(
                "safety.function: heading-aware needs normal agents that are unicycles, with "
                f"states x, y, theta; got {got}"
            )
        heading = ca.vertcat(ca.cos(a.x[2]), ca.sin(a.x[2]))
        return clearance + self.kappa * (1 - ca.dot(heading, away)) - distance
