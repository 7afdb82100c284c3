"""Integrators of first, second and third order, in the plane and in space."""

import math
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
from annotated_types import Ge, Gt

from phalanx.arrays import Array
from phalanx.theory.models.dynamics import box_polytope

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True)
class SingleIntegrator:
    """p' = u + φ with |u_c| <= speed; 2-D or 3-D."""

    speed: Positive
    """Bound on every velocity component [m/s]."""
    dimension: int = 2

    def __post_init__(self) -> None:
        _check_dimension(self.dimension)

    @property
    def states(self) -> tuple[str, ...]:
        return ("x", "y", "z")[: self.dimension]

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("vx", "vy", "vz")[: self.dimension]

    @property
    def state_units(self) -> tuple[str, ...]:
        return _each("m", axes=self.dimension)

    @property
    def input_units(self) -> tuple[str, ...]:
        return _each("m/s", axes=self.dimension)

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(self.dimension)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.SX.eye(self.dimension)

    def position(self, x: ca.SX) -> ca.SX:
        return x

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.speed,) * self.dimension)

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,) * self.dimension

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        return (_longest(self.speed, self.dimension) + disturbance) * time


@dataclass(frozen=True)
class DoubleIntegrator:
    """p' = v, v' = u - β v with |u_c| <= acceleration, as in Simulation 2; q = 2.

    With β > 0 every component of v stays below acceleration / β, once it is.
    """

    acceleration: Positive
    """Bound on every component of the input [m/s²]."""
    drag: Annotated[float, Ge(0)] = 0.0
    """β [1/s]."""
    dimension: int = 3

    def __post_init__(self) -> None:
        _check_dimension(self.dimension)

    @property
    def states(self) -> tuple[str, ...]:
        return ("x", "y", "z")[: self.dimension] + ("vx", "vy", "vz")[: self.dimension]

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("ax", "ay", "az")[: self.dimension]

    @property
    def state_units(self) -> tuple[str, ...]:
        return _each("m", "m/s", axes=self.dimension)

    @property
    def input_units(self) -> tuple[str, ...]:
        return _each("m/s²", axes=self.dimension)

    def drift(self, x: ca.SX) -> ca.SX:
        v = x[self.dimension :]
        return ca.vertcat(v, -self.drag * v)

    def actuation(self, x: ca.SX) -> ca.SX:
        return _last_of(2, self.dimension)

    def position(self, x: ca.SX) -> ca.SX:
        return x[: self.dimension]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.acceleration,) * self.dimension)

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,) * self.dimension

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        speed = math.hypot(*x[self.dimension :]) + disturbance
        gain = _longest(self.acceleration, self.dimension) + disturbance
        return speed * time + gain * time**2 / 2


@dataclass(frozen=True)
class TripleIntegrator:
    """p' = v, v' = a, a' = u with |u_c| <= jerk; q = 3."""

    jerk: Positive
    """Bound on every component of the input [m/s³]."""
    dimension: int = 3

    def __post_init__(self) -> None:
        _check_dimension(self.dimension)

    @property
    def states(self) -> tuple[str, ...]:
        d = self.dimension
        return ("x", "y", "z")[:d] + ("vx", "vy", "vz")[:d] + ("ax", "ay", "az")[:d]

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("jx", "jy", "jz")[: self.dimension]

    @property
    def state_units(self) -> tuple[str, ...]:
        return _each("m", "m/s", "m/s²", axes=self.dimension)

    @property
    def input_units(self) -> tuple[str, ...]:
        return _each("m/s³", axes=self.dimension)

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[self.dimension :], ca.SX.zeros(self.dimension))

    def actuation(self, x: ca.SX) -> ca.SX:
        return _last_of(3, self.dimension)

    def position(self, x: ca.SX) -> ca.SX:
        return x[: self.dimension]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.jerk,) * self.dimension)

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,) * self.dimension

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        d = self.dimension
        speed = math.hypot(*x[d : 2 * d]) + disturbance
        gain = math.hypot(*x[2 * d :]) + disturbance
        jerk = _longest(self.jerk, d) + disturbance
        return speed * time + gain * time**2 / 2 + jerk * time**3 / 6


def _each(*units: str, axes: int) -> tuple[str, ...]:
    """Every unit once for each axis."""
    return tuple(unit for unit in units for _ in range(axes))


def _last_of(order: int, dimension: int) -> ca.SX:
    """g of an integrator: inputs enter the last of `order` blocks, and structurally no other."""
    zeros = ca.SX((order - 1) * dimension, dimension)
    return ca.vertcat(zeros, ca.SX.eye(dimension))


def _longest(bound: float, dimension: int) -> float:
    """Of the vectors whose components are at most `bound`."""
    return math.sqrt(dimension) * bound


def _check_dimension(dimension: int) -> None:
    if dimension not in (2, 3):
        raise ValueError(f"dimension: expected 2 or 3, got {dimension}")
