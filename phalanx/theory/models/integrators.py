"""Integrators of first, second and third order, in the plane and in space."""

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar

import casadi as ca
from annotated_types import Ge

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Positive, box_polytope


class _Integrator:
    """p^(q) = u: blocks of d states each, the output point first, inputs in the last one's rate."""

    dimension: int
    _bound: ClassVar[str]
    """Name of the field with the bound on every component of the input."""
    _blocks: ClassVar[tuple[tuple[str, str], ...]]
    """Prefix of the names and unit, for each block of states and last for the inputs."""

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3):
            raise ValueError(f"dimension: expected 2 or 3, got {self.dimension}")

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

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(x[self.dimension :], ca.SX.zeros(self.dimension))

    def actuation(self, x: ca.SX) -> ca.SX:
        # Structurally in the last block, and in no other.
        zeros = ca.SX((len(self._blocks) - 2) * self.dimension, self.dimension)
        return ca.vertcat(zeros, ca.SX.eye(self.dimension))

    def position(self, x: ca.SX) -> ca.SX:
        return x[: self.dimension]

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((getattr(self, self._bound),) * self.dimension)

    def input_metric(self) -> tuple[float, ...]:
        return (1.0,) * self.dimension

    def travel(self, x: Array, time: float, disturbance: float) -> float:
        # Taylor's formula: the norms of p', p'', ..., and last that of the largest input.
        derivatives = x.reshape(-1, self.dimension)[1:]
        largest = math.sqrt(self.dimension) * getattr(self, self._bound)
        norms = [*(math.hypot(*derivative) for derivative in derivatives), largest]
        total = 0.0
        for k, norm in enumerate(norms, start=1):
            total += (norm + disturbance) * time**k / math.factorial(k)
        return total


@dataclass(frozen=True)
class SingleIntegrator(_Integrator):
    """p' = u + φ with |u_c| <= speed; 2-D or 3-D.

    >>> SingleIntegrator(speed=2.0).inputs
    ('vx', 'vy')
    """

    speed: Positive
    """Bound on every velocity component [m/s]."""
    dimension: int = 2
    _bound = "speed"
    _blocks = (("", "m"), ("v", "m/s"))


@dataclass(frozen=True)
class DoubleIntegrator(_Integrator):
    """p' = v, v' = u - β v with |u_c| <= acceleration, as in Simulation 2; q = 2.

    With β > 0 every component of v stays below acceleration / β, once it is.

    >>> DoubleIntegrator(acceleration=2.0, dimension=2).states
    ('x', 'y', 'vx', 'vy')
    """

    acceleration: Positive
    """Bound on every component of the input [m/s²]."""
    drag: Annotated[float, Ge(0)] = 0.0
    """β [1/s]."""
    dimension: int = 3
    _bound = "acceleration"
    _blocks = (("", "m"), ("v", "m/s"), ("a", "m/s²"))

    def drift(self, x: ca.SX) -> ca.SX:
        v = x[self.dimension :]
        return ca.vertcat(v, -self.drag * v)


@dataclass(frozen=True)
class TripleIntegrator(_Integrator):
    """p' = v, v' = a, a' = u with |u_c| <= jerk; q = 3.

    >>> TripleIntegrator(jerk=4.0, dimension=2).state_units
    ('m', 'm', 'm/s', 'm/s', 'm/s²', 'm/s²')
    """

    jerk: Positive
    """Bound on every component of the input [m/s³]."""
    dimension: int = 3
    _bound = "jerk"
    _blocks = (("", "m"), ("v", "m/s"), ("a", "m/s²"), ("j", "m/s³"))
