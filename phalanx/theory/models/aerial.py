"""Quadrotors whose attitude loop is part of the model: in a vertical plane, and in space.

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
    """Position, velocity, specific thrust c above hover, d - 1 tilt angles, and more; yaw is zero.

    v' = (g + c) n - g e_z, with n the thrust direction.
    """

    thrust: float
    tilt: float
    inputs: tuple[str, ...]

    @property
    def _axes(self) -> int:
        """Dimension d of the space: as many as inputs."""
        return len(self.inputs)

    def _lift(self, x: ca.SX) -> ca.SX:
        """v' without drag, shape (d,), up last."""
        d = self._axes
        c, angles = x[2 * d], x[2 * d + 1 : 3 * d]
        weight = ca.vertcat(ca.SX.zeros(d - 1), GRAVITY)
        return (GRAVITY + c) * _direction(angles) - weight

    def position(self, x: ca.SX) -> ca.SX:
        return x[: self._axes]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.thrust,) + (self.tilt,) * (self._axes - 1))

    def input_metric(self) -> tuple[float, ...]:
        # Near hover an angle of θ accelerates by g θ.
        return (1.0,) + (GRAVITY * GRAVITY,) * (self._axes - 1)


def _direction(angles: ca.SX) -> ca.SX:
    """Unit vector of the thrust by pitch θ alone, or by pitch and roll φ."""
    theta = angles[0]
    if angles.numel() == 1:
        return ca.vertcat(ca.sin(theta), ca.cos(theta))
    phi = angles[1]
    return ca.vertcat(ca.cos(phi) * ca.sin(theta), -ca.sin(phi), ca.cos(phi) * ca.cos(theta))


@dataclass(frozen=True)
class _Multirotor(_Rotorcraft):
    """c' = (u_c - c) / thrust_lag, and θ' = (u_θ - θ) / tilt_lag for each angle θ.

    Once |c| and |θ| are within their bounds, they stay there but for the disturbance.
    """

    thrust: Positive
    """Bound on the commanded specific thrust above hover [m/s²]."""
    tilt: Positive
    """Bound on every commanded tilt angle [rad]."""
    thrust_lag: Positive = 0.1
    """Time constant of the rotors [s]."""
    tilt_lag: Positive = 0.15
    """Time constant of the attitude loop [s]."""

    def __post_init__(self) -> None:
        if self.thrust >= GRAVITY:
            raise ValueError(f"thrust: expected less than {GRAVITY}, since rotors only push up")
        if self.tilt >= math.pi / 2:
            raise ValueError(f"tilt: expected less than pi / 2, got {self.tilt}")

    def drift(self, x: ca.SX) -> ca.SX:
        d = self._axes
        c, angles = x[2 * d], x[2 * d + 1 :]
        lags = -c / self.thrust_lag, -angles / self.tilt_lag
        return ca.vertcat(x[d : 2 * d], self._lift(x), *lags)

    def actuation(self, x: ca.SX) -> ca.SX:
        d = self._axes
        rates = [1.0 / self.thrust_lag] + [1.0 / self.tilt_lag] * (d - 1)
        return ca.vertcat(ca.SX(2 * d, d), ca.diag(ca.SX(ca.DM(rates))))

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        # ‖v'‖ = ‖c n + g (n - e_z)‖, and ‖n - e_z‖ is at most the sum of the angles.
        d = self._axes
        extra = disturbance * time
        c = max(abs(float(x[2 * d])), self.thrust) + extra
        angles = sum(max(abs(float(angle)), self.tilt) + extra for angle in x[2 * d + 1 :])
        gain = c + GRAVITY * min(angles, 2.0) + disturbance
        return (math.hypot(*x[d : 2 * d]) + disturbance) * time + gain * time**2 / 2


@dataclass(frozen=True)
class PlanarQuadrotor(_Multirotor):
    """Quadrotor in a vertical plane: x is horizontal, z up; pitch θ tilts the thrust towards +x."""

    states = ("x", "z", "vx", "vz", "c", "theta")
    inputs = ("c", "theta")
    state_units = ("m", "m", "m/s", "m/s", "m/s²", "rad")
    input_units = ("m/s²", "rad")


@dataclass(frozen=True)
class Quadrotor(_Multirotor):
    """Quadrotor in space with yaw zero: pitch θ tilts the thrust towards +x, roll φ towards -y."""

    states = ("x", "y", "z", "vx", "vy", "vz", "c", "theta", "phi")
    inputs = ("c", "theta", "phi")
    state_units = ("m",) * 3 + ("m/s",) * 3 + ("m/s²", "rad", "rad")
    input_units = ("m/s²", "rad", "rad")


@dataclass(frozen=True)
class IdentifiedQuadrotor(_Rotorcraft):
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

    states = (*Quadrotor.states, "r", "theta_rate", "phi_rate")
    inputs = Quadrotor.inputs
    state_units = (*Quadrotor.state_units, "m/s²", "rad/s", "rad/s")
    input_units = Quadrotor.input_units

    def drift(self, x: ca.SX) -> ca.SX:
        v, c, angles, r, rates = x[3:6], x[6], x[7:9], x[9], x[10:]
        lift = self._lift(x) - self.drag * v
        swing = -self.stiffness * angles - self.damping * rates
        return ca.vertcat(v, lift, (r - c) / self.thrust_lag, rates, -r / self.filter_lag, swing)

    def actuation(self, x: ca.SX) -> ca.SX:
        gains = np.diag([1.0 / self.filter_lag, self.stiffness, self.stiffness])
        return ca.vertcat(ca.SX(9, 3), ca.sparsify(ca.SX(gains)))
