"""Wheeled robots: Simulation 1's unicycle, one with mass, and differential drive."""

import math
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
from annotated_types import Ge

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Positive, box_polytope


class _Differential:
    """State (x, y, θ, ...), with the output point at a distance b = `offset` ahead of the axle."""

    offset: float

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2] + self.offset * ca.vertcat(ca.cos(x[2]), ca.sin(x[2]))

    def input_metric(self) -> tuple[float, ...]:
        # ‖u - u_nom‖² of the output point's velocity or acceleration, in terms of ν and ω.
        return (1.0, self.offset * self.offset)


@dataclass(frozen=True)
class Unicycle(_Differential):
    """Unicycle with its output point ahead of the axle, Eq. (IOoutputs).

    State (x, y, θ); native input (ν, ω), which is what the actuator holds between samples.
    The paper's output input is u = R(θ) diag(1, b) (ν, ω), so its polytope
    Eq. (IOcontrolbounds) is the box |ν| <= speed, |ω| <= turn_rate, constant in (ν, ω).

    >>> Unicycle(speed=1.0, turn_rate=2.0).position(ca.DM([1, 2, 0]))
    DM([1.25, 2])
    """

    speed: Positive
    """ν^max [m/s]."""
    turn_rate: Positive
    """ω^max [rad/s]."""
    offset: Positive = 0.25
    """b [m]: distance of the output point from the axle."""

    states = ("x", "y", "theta")
    inputs = ("nu", "omega")
    state_units = ("m", "m", "rad")
    input_units = ("m/s", "rad/s")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(3)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.horzcat(ca.cos(x[2]), 0), ca.horzcat(ca.sin(x[2]), 0), ca.SX([[0, 1]]))

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.speed, self.turn_rate))

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        # p' = ν (cos θ, sin θ) + b (ω + φ_θ) (-sin θ, cos θ) + φ_xy.
        fastest = math.hypot(self.speed, self.offset * self.turn_rate)
        return (fastest + math.hypot(1.0, self.offset) * disturbance) * time


@dataclass(frozen=True)
class DynamicUnicycle(_Differential):
    """Unicycle with mass: its inputs are accelerations, so its speeds cannot jump; q = 2.

    State (x, y, θ, ν, ω); ν' = a - drag ν, ω' = α - turn_drag ω. With drag > 0, |ν| stays below
    acceleration / drag once it is; so does |ω|.

    >>> robot = DynamicUnicycle(acceleration=2.0, turn_acceleration=4.0)
    >>> robot.drift(ca.DM([0, 0, 0, 1, 0.5]))
    DM([1, 0, 0.5, -0, -0])
    """

    acceleration: Positive
    """Bound on a [m/s²]."""
    turn_acceleration: Positive
    """Bound on α [rad/s²]."""
    offset: Positive = 0.25
    """Distance of the output point from the axle [m]."""
    drag: Annotated[float, Ge(0)] = 0.0
    """[1/s]"""
    turn_drag: Annotated[float, Ge(0)] = 0.0
    """[1/s]"""

    states = ("x", "y", "theta", "nu", "omega")
    inputs = ("a", "alpha")
    state_units = ("m", "m", "rad", "m/s", "rad/s")
    input_units = ("m/s²", "rad/s²")

    def drift(self, x: ca.SX) -> ca.SX:
        theta, nu, omega = x[2], x[3], x[4]
        slowed = ca.vertcat(-self.drag * nu, -self.turn_drag * omega)
        return ca.vertcat(nu * ca.cos(theta), nu * ca.sin(theta), omega, slowed)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.SX(3, 2), ca.SX.eye(2))

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.acceleration, self.turn_acceleration))

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        # |ν| and b |ω| grow by no more than their inputs and the disturbance allow.
        speed = abs(float(x[3])) + self.offset * abs(float(x[4]))
        gain = self.acceleration + self.offset * self.turn_acceleration
        pushed = math.hypot(1.0, self.offset) * disturbance
        return (speed + pushed) * time + (gain + pushed) * time**2 / 2


@dataclass(frozen=True)
class DifferentialDrive(_Differential):
    """Two driven wheels, whose rates are the inputs, and an output point ahead of the axle.

    State (x, y, θ); inputs the rates ω_l and ω_r of the left and right wheel. The robot moves as a
    unicycle with ν = r (ω_r + ω_l) / 2 and ω = r (ω_r - ω_l) / track: fast turns leave less speed.

    >>> DifferentialDrive(wheel_rate=10.0, wheel_radius=0.5, track=1.0).inputs
    ('omega_l', 'omega_r')
    """

    wheel_rate: Positive
    """Bound on every wheel's rate [rad/s]."""
    wheel_radius: Positive
    """r [m]"""
    track: Positive
    """Distance between the wheels [m]."""
    offset: Positive = 0.25
    """Distance of the output point from the axle [m]."""

    states = ("x", "y", "theta")
    inputs = ("omega_l", "omega_r")
    state_units = ("m", "m", "rad")
    input_units = ("rad/s", "rad/s")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(3)

    def actuation(self, x: ca.SX) -> ca.SX:
        ahead, turn = self.wheel_radius / 2, self.wheel_radius / self.track
        forward = ahead * ca.vertcat(ca.cos(x[2]), ca.sin(x[2]))
        return ca.vertcat(ca.horzcat(forward, forward), ca.SX([[-turn, turn]]))

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.wheel_rate, self.wheel_rate))

    def input_metric(self) -> tuple[float, ...]:
        return (1.0, 1.0)

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        # ‖p'‖ is convex in the wheels' rates, so the largest is at a corner: straight on or a spin.
        turn = self.offset * 2.0 / self.track
        fastest = self.wheel_rate * self.wheel_radius * max(1.0, turn)
        return (fastest + math.hypot(1.0, self.offset) * disturbance) * time
