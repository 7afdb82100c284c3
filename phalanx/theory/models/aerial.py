"""Quadrotors whose attitude loop is part of the model: in a vertical plane, and in space.

The inputs are what an autopilot accepts: a thrust and tilt angles. It follows them with first-order
lags, so the inputs act on the third derivative of the position: q = 3. Zero inputs hover.
"""

import math
from dataclasses import dataclass

import casadi as ca

from phalanx.arrays import Array
from phalanx.theory.models.dynamics import Positive, box_polytope

GRAVITY = 9.81
"""[m/s²]"""


@dataclass(frozen=True)
class _Multirotor:
    """Position, velocity, specific thrust above hover, tilt angles; yaw is zero.

    v' = (g + c) n - g e_z with n the thrust direction, c' = (u_c - c) / thrust_lag and
    θ' = (u_θ - θ) / tilt_lag for each angle θ. Once |c| and |θ| are within their bounds, they stay
    there but for the disturbance.
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

    @property
    def _axes(self) -> int:
        """Dimension d of the space, with d - 1 tilt angles."""
        raise NotImplementedError

    def _direction(self, angles: ca.SX) -> ca.SX:
        """Unit vector of the thrust, shape (d,), up last."""
        raise NotImplementedError

    def drift(self, x: ca.SX) -> ca.SX:
        d = self._axes
        c, angles = x[2 * d], x[2 * d + 1 :]
        weight = ca.vertcat(ca.SX.zeros(d - 1), GRAVITY)
        lift = (GRAVITY + c) * self._direction(angles) - weight
        return ca.vertcat(x[d : 2 * d], lift, -c / self.thrust_lag, -angles / self.tilt_lag)

    def actuation(self, x: ca.SX) -> ca.SX:
        d = self._axes
        rates = [1.0 / self.thrust_lag] + [1.0 / self.tilt_lag] * (d - 1)
        return ca.vertcat(ca.SX(2 * d, d), ca.diag(ca.SX(ca.DM(rates))))

    def position(self, x: ca.SX) -> ca.SX:
        return x[: self._axes]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.thrust,) + (self.tilt,) * (self._axes - 1))

    def input_metric(self) -> tuple[float, ...]:
        # Near hover an angle of θ accelerates by g θ.
        return (1.0,) + (GRAVITY * GRAVITY,) * (self._axes - 1)

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
    _axes = 2

    def _direction(self, angles: ca.SX) -> ca.SX:
        return ca.vertcat(ca.sin(angles[0]), ca.cos(angles[0]))


@dataclass(frozen=True)
class Quadrotor(_Multirotor):
    """Quadrotor in space with yaw zero: pitch θ tilts the thrust towards +x, roll φ towards -y."""

    states = ("x", "y", "z", "vx", "vy", "vz", "c", "theta", "phi")
    inputs = ("c", "theta", "phi")
    state_units = ("m", "m", "m", "m/s", "m/s", "m/s", "m/s²", "rad", "rad")
    input_units = ("m/s²", "rad", "rad")
    _axes = 3

    def _direction(self, angles: ca.SX) -> ca.SX:
        theta, phi = angles[0], angles[1]
        return ca.vertcat(ca.cos(phi) * ca.sin(theta), -ca.sin(phi), ca.cos(phi) * ca.cos(theta))
