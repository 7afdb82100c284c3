"""Quadrotors in space whose attitude loop is part of the model.

The inputs are what an autopilot accepts: a thrust and tilt angles. Zero inputs hover. With lags of
first order the inputs act on the third derivative of the position, q = 3. With those that fits to
flights have, it is the fourth, q = 4.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from annotated_types import Ge, Gt, Lt

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Positive, box_polytope

GRAVITY = 9.81
"""[m/s²]"""


class _Rotorcraft:
    """Position, velocity, specific thrust c above hover, pitch θ, roll φ, and more; yaw is zero.

    v' = (g + c) n - g e_z, with n the thrust direction.
    """

    thrust: float
    tilt: float
    inputs = ("c", "theta", "phi")
    input_units = ("m/s²", "rad", "rad")

    def position(self, x: ca.SX) -> ca.SX:
        return x[:3]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.thrust, self.tilt, self.tilt))

    def input_metric(self) -> tuple[float, ...]:
        # Near hover an angle of θ accelerates by g θ.
        return (1.0, GRAVITY * GRAVITY, GRAVITY * GRAVITY)


def _lift(x: ca.SX) -> ca.SX:
    """v' without drag, shape (3,), up last."""
    c, theta, phi = x[6], x[7], x[8]
    n = ca.vertcat(ca.cos(phi) * ca.sin(theta), -ca.sin(phi), ca.cos(phi) * ca.cos(theta))
    return (GRAVITY + c) * n - ca.vertcat(ca.SX.zeros(2), GRAVITY)


@dataclass(frozen=True)
class Quadrotor(_Rotorcraft):
    """Quadrotor in space with yaw zero: pitch θ tilts the thrust towards +x, roll φ towards -y.

    c' = (u_c - c) / thrust_lag, and so θ and φ with tilt_lag. Once |c|, |θ| and |φ| are within
    their bounds, they stay there but for the disturbance.

    >>> Quadrotor(thrust=5.0, tilt=0.5).input_metric()[0]
    1.0
    """

    thrust: Positive
    """Bound on the commanded specific thrust above hover [m/s²]."""
    tilt: Positive
    """Bound on every commanded tilt angle [rad]."""
    thrust_lag: Positive = 0.1
    """Time constant of the rotors [s]."""
    tilt_lag: Positive = 0.15
    """Time constant of the attitude loop [s]."""

    states = ("x", "y", "z", "vx", "vy", "vz", "c", "theta", "phi")
    state_units = ("m",) * 3 + ("m/s",) * 3 + ("m/s²", "rad", "rad")

    def __post_init__(self) -> None:
        if self.thrust >= GRAVITY:
            raise ValueError(f"thrust: expected less than {GRAVITY}, since rotors only push up")
        if self.tilt >= math.pi / 2:
            raise ValueError(f"tilt: expected less than pi / 2, got {self.tilt}")

    def drift(self, x: ca.SX) -> ca.SX:
        lags = -x[6] / self.thrust_lag, -x[7:] / self.tilt_lag
        return ca.vertcat(x[3:6], _lift(x), *lags)

    def actuation(self, x: ca.SX) -> ca.SX:
        rates = [1.0 / self.thrust_lag, 1.0 / self.tilt_lag, 1.0 / self.tilt_lag]
        return ca.vertcat(ca.SX(6, 3), ca.diag(ca.SX(ca.DM(rates))))

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        # ‖v'‖ = ‖c n + g (n - e_z)‖, and ‖n - e_z‖ is at most the sum of the angles.
        extra = disturbance * time
        c = max(abs(float(x[6])), self.thrust) + extra
        angles = sum(max(abs(float(angle)), self.tilt) + extra for angle in x[7:])
        gain = c + GRAVITY * min(angles, 2.0) + disturbance
        return (math.hypot(*x[3:6]) + disturbance) * time + gain * time**2 / 2


@dataclass(frozen=True)
class IdentifiedQuadrotor(_Rotorcraft):
    """Quadrotor in space with yaw zero, whose angles swing: θ'' = k (u_θ - θ) - b θ', and so φ.

    v' = (g + c) n - g e_z - drag v, with n as in `quadrotor`. A filter aboard smooths the commanded
    thrust, r' = (u_c - r) / filter_lag, and the rotors follow, c' = (r - c) / thrust_lag: all
    inputs act on the fourth derivative of the position, q = 4.

    >>> IdentifiedQuadrotor(3.0, 0.3, 0.1, 0.05, stiffness=320.0, damping=20.0).states[6:]
    ('c', 'theta', 'phi', 'r', 'theta_rate', 'phi_rate')
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

    states = (*Quadrotor.states, "r", "theta_rate", "phi_rate")
    state_units = (*Quadrotor.state_units, "m/s²", "rad/s", "rad/s")

    def drift(self, x: ca.SX) -> ca.SX:
        v, c, angles, r, rates = x[3:6], x[6], x[7:9], x[9], x[10:]
        lift = _lift(x) - self.drag * v
        swing = -self.stiffness * angles - self.damping * rates
        return ca.vertcat(v, lift, (r - c) / self.thrust_lag, rates, -r / self.filter_lag, swing)

    def actuation(self, x: ca.SX) -> ca.SX:
        gains = np.diag([1.0 / self.filter_lag, self.stiffness, self.stiffness])
        return ca.vertcat(ca.SX(9, 3), ca.sparsify(ca.SX(gains)))
