"""The kinematic bicycle: nonlinear, of relative degree 2."""

from dataclasses import dataclass
from typing import Annotated

import casadi as ca
from annotated_types import Gt

from phalanx.theory.models.dynamics import box_polytope

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True)
class KinematicBicycle:
    """(x, y) the rear axle, x' = v cos θ, y' = v sin θ, θ' = v s / wheelbase, v' = a.

    The inputs are the acceleration a and s, the tangent of the steering angle, in which the
    dynamics are affine. The axle's acceleration is a along the heading and v² s / wheelbase
    across it, so both inputs appear in ψ_2; steering has no authority at standstill.
    """

    acceleration: Positive
    """Bound on a [m/s²]."""
    steering: Positive
    """Bound on the tangent of the steering angle."""
    wheelbase: Positive = 0.5
    """[m]"""

    states = ("x", "y", "theta", "v")
    inputs = ("a", "s")
    state_units = ("m", "m", "rad", "m/s")
    input_units = ("m/s²", "1")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[3] * ca.cos(x[2]), x[3] * ca.sin(x[2]), 0, 0)

    def actuation(self, x: ca.SX) -> ca.SX:
        g = ca.SX(4, 2)
        g[2, 1] = x[3] / self.wheelbase
        g[3, 0] = 1
        return g

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.acceleration, self.steering))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 1.0)
