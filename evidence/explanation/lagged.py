"""A robot of one's own: it takes a velocity and reaches it with a lag of first order, q = 2."""

from dataclasses import dataclass

import casadi as ca

from phalanx.extend import box_polytope


@dataclass
class Lagged:
    """v' = (u - v) / lag; state (x, y, vx, vy), input: the commanded velocity."""

    speed: float  # m/s
    lag: float  # s

    states = ("x", "y", "vx", "vy")
    inputs = ("ux", "uy")
    state_units = ("m", "m", "m/s", "m/s")
    input_units = ("m/s", "m/s")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[2:], -x[2:] / self.lag)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.SX.zeros(2, 2), ca.SX.eye(2) / self.lag)

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.speed, self.speed))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 1.0)
