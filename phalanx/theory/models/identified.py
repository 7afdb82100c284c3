"""Quadrotor with the lags that fits to flights have: attitude of second order, and drag."""

import math
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from annotated_types import Ge, Gt, Lt

from phalanx.theory.models.aerial import GRAVITY
from phalanx.theory.models.dynamics import Positive, box_polytope


@dataclass(frozen=True)
class IdentifiedQuadrotor:
    """Quadrotor in space with yaw zero, whose angles swing: θ'' = k (u_θ - θ) - b θ', and so φ.

    v' = (g + c) n - g e_z - drag v, with n as in `quadrotor`. A filter aboard smooths the commanded
    thrust, r' = (u_c - r) / filter_lag, and the rotors follow, c' = (r - c) / thrust_lag: all
    inputs act on the fourth derivative of the position, q = 4.
    """

    thrust: Annotated[float, Gt(0), Lt(GRAVITY)]
    """Bound on the commanded specific thrust above hover [m/s²]."""
    tilt: Annotated[float, Gt(0), Lt(math.pi / 2)]
    """Bound on every commanded tilt angle [rad]."""
    thrust_lag: Positive
    """Time constant of the rotors [s]."""
    filter_lag: Positive
    """Time constant of the filter before them [s]."""
    stiffness: Positive
    """k [1/s²]"""
    damping: Positive
    """b [1/s]"""
    drag: Annotated[float, Ge(0)] = 0.0
    """[1/s]"""

    states = ("x", "y", "z", "vx", "vy", "vz", "c", "theta", "phi", "r", "theta_rate", "phi_rate")
    inputs = ("c", "theta", "phi")
    state_units = ("m",) * 3 + ("m/s",) * 3 + ("m/s²", "rad", "rad", "m/s²", "rad/s", "rad/s")
    input_units = ("m/s²", "rad", "rad")

    def drift(self, x: ca.SX) -> ca.SX:
        v, c, theta, phi, angles, r, rates = x[3:6], x[6], x[7], x[8], x[7:9], x[9], x[10:]
        n = ca.vertcat(ca.cos(phi) * ca.sin(theta), -ca.sin(phi), ca.cos(phi) * ca.cos(theta))
        lift = (GRAVITY + c) * n - ca.vertcat(0.0, 0.0, GRAVITY) - self.drag * v
        swing = -self.stiffness * angles - self.damping * rates
        return ca.vertcat(v, lift, (r - c) / self.thrust_lag, rates, -r / self.filter_lag, swing)

    def actuation(self, x: ca.SX) -> ca.SX:
        gains = np.diag([1.0 / self.filter_lag, self.stiffness, self.stiffness])
        return ca.vertcat(ca.SX(9, 3), ca.sparsify(ca.SX(gains)))

    def position(self, x: ca.SX) -> ca.SX:
        return x[:3]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.thrust, self.tilt, self.tilt))

    def input_metric(self) -> tuple[float, ...]:
        # Near hover an angle of θ accelerates by g θ.
        return (1.0, GRAVITY * GRAVITY, GRAVITY * GRAVITY)
