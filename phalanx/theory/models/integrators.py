"""Integrators of first, second and third order, in the plane and in space."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import casadi as ca
from annotated_types import Ge

from phalanx.arrays import Array
from phalanx.theory.models.dynamics import Positive, box_polytope


class _Integrator:
    """p^(q) = u: blocks of d states each, the output point first, inputs in the last one's rate."""

    dimension: int
    _blocks: ClassVar[tuple[tuple[str, str], ...]]
    """Prefix of the names and unit, for each block of states and last for the inputs."""

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3):
            raise ValueError(f"dimension: expected 2 or 3, got {self.dimension}")

    @property
    def bound(self) -> float:
        """Bound on every component of the input."""
        raise NotImplementedError

    @property
    def states(self) -> tuple[str, ...]:
        return tuple(name + axis for name, _ in self._blocks[:-1] for axis in self._axes)

    @property
    def inputs(self) -> tuple[str, ...]:
        return tuple(self._blocks[-1][0] + axis for axis in self._axes)

    @property
    def state_units(self) -> tuple[str, ...]:
        return tuple(unit for _, unit in self._blocks[:-1] for _ in self._axes)

    @property
    def input_units(self) -> tuple[str, ...]:
        return (self._blocks[-1][1],) * self.dimension

    @property
    def _axes(self) -> str:
        return "xyz"[: self.dimension]

    def actuation(self, x: ca.SX) -> ca.SX:
        # Structurally in the last block, and in no other.
        zeros = ca.SX((len(self._blocks) - 2) * self.dimension, self.dimension)
        return ca.vertcat(zeros, ca.SX.eye(self.dimension))

    def position(self, x: ca.SX) -> ca.SX:
        return x[: self.dimension]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.bound,) * self.dimension)

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,) * self.dimension

    def _longest(self) -> float:
        """The largest norm of an input."""
        return math.sqrt(self.dimension) * self.bound


@dataclass(frozen=True)
class SingleIntegrator(_Integrator):
    """p' = u + φ with |u_c| <= speed; 2-D or 3-D."""

    speed: Positive
    """Bound on every velocity component [m/s]."""
    dimension: int = 2
    _blocks = (("", "m"), ("v", "m/s"))

    @property
    def bound(self) -> float:
        return self.speed

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(self.dimension)

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        return (self._longest() + disturbance) * time


@dataclass(frozen=True)
class DoubleIntegrator(_Integrator):
    """p' = v, v' = u - β v with |u_c| <= acceleration, as in Simulation 2; q = 2.

    With β > 0 every component of v stays below acceleration / β, once it is.
    """

    acceleration: Positive
    """Bound on every component of the input [m/s²]."""
    drag: Annotated[float, Ge(0)] = 0.0
    """β [1/s]."""
    dimension: int = 3
    _blocks = (("", "m"), ("v", "m/s"), ("a", "m/s²"))

    @property
    def bound(self) -> float:
        return self.acceleration

    def drift(self, x: ca.SX) -> ca.SX:
        v = x[self.dimension :]
        return ca.vertcat(v, -self.drag * v)

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        speed = math.hypot(*x[self.dimension :]) + disturbance
        gain = self._longest() + disturbance
        return speed * time + gain * time**2 / 2


@dataclass(frozen=True)
class TripleIntegrator(_Integrator):
    """p' = v, v' = a, a' = u with |u_c| <= jerk; q = 3."""

    jerk: Positive
    """Bound on every component of the input [m/s³]."""
    dimension: int = 3
    _blocks = (("", "m"), ("v", "m/s"), ("a", "m/s²"), ("j", "m/s³"))

    @property
    def bound(self) -> float:
        return self.jerk

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[self.dimension :], ca.SX.zeros(self.dimension))

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        d = self.dimension
        speed = math.hypot(*x[d : 2 * d]) + disturbance
        gain = math.hypot(*x[2 * d :]) + disturbance
        jerk = self._longest() + disturbance
        return speed * time + gain * time**2 / 2 + jerk * time**3 / 6
