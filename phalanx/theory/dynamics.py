"""Control-affine dynamics x' = f(x) + g(x) u + φ with inputs in a polytope, Eq. (generalsystem)."""

from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import casadi as ca
import numpy as np
from annotated_types import Gt

Positive = Annotated[float, Gt(0)]


@runtime_checkable
class Dynamics(Protocol):
    """What an agent's dynamics must say of itself. Expressions are CasADi; units are SI.

    A dataclass with these members is a dynamics; a scenario names it ``package.module:Name``.
    """

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the n states."""

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the m inputs."""

    def drift(self, x: ca.SX) -> ca.SX:
        """f(x), shape (n,)."""

    def actuation(self, x: ca.SX) -> ca.SX:
        """g(x), shape (n, m)."""

    def position(self, x: ca.SX) -> ca.SX:
        """The output point p(x) [m], shape (2,) or (3,): what pairs keep apart."""

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        """A(x), shape (r, m), and b(x), shape (r,), with U(x) = {u : A(x) u <= b(x)} compact."""

    def input_metric(self) -> tuple[float, ...]:
        """Weights w, shape (m,): the QP minimises the sum of w (u - u_nom)²."""


def box_polytope(bounds: tuple[float, ...]) -> tuple[ca.SX, ca.SX]:
    """The box |u_c| <= bounds_c as (A, b), shapes (2m, m) and (2m,)."""
    identity = np.eye(len(bounds))
    return ca.SX(np.vstack([identity, -identity])), ca.SX(np.array([*bounds, *bounds]))


@dataclass(frozen=True)
class Unicycle:
    """Unicycle with its output point ahead of the axle, Eq. (IOoutputs).

    State (x, y, θ); native input (ν, ω), which is what the actuator holds between samples.
    The paper's output input is u = R(θ) diag(1, b) (ν, ω), so its polytope
    Eq. (IOcontrolbounds) is the box |ν| <= speed, |ω| <= turn_rate, constant in (ν, ω).
    """

    speed: Positive
    """ν^max [m/s]."""
    turn_rate: Positive
    """ω^max [rad/s]."""
    offset: Positive = 0.25
    """b [m]: distance of the output point from the axle."""

    states = ("x", "y", "theta")
    inputs = ("nu", "omega")

    def drift(self, x: ca.SX) -> ca.SX:
        return ca.SX.zeros(3)

    def actuation(self, x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.horzcat(ca.cos(x[2]), 0), ca.horzcat(ca.sin(x[2]), 0), ca.SX([[0, 1]]))

    def position(self, x: ca.SX) -> ca.SX:
        return x[:2] + self.offset * ca.vertcat(ca.cos(x[2]), ca.sin(x[2]))

    def input_polytope(self, x: ca.SX) -> tuple[ca.SX, ca.SX]:
        return box_polytope((self.speed, self.turn_rate))

    def input_metric(self) -> tuple[float, ...]:
        # ‖u - u_nom‖² of the output input, written in (ν, ω).
        return (1.0, self.offset**2)


@dataclass(frozen=True)
class SingleIntegrator:
    """p' = u + φ with |u_c| <= speed; 2-D or 3-D."""

    speed: Positive
    """Bound on every velocity component [m/s]."""
    dimension: int = 2

    def __post_init__(self) -> None:
        if self.dimension not in (2, 3):
            raise ValueError(f"dimension: expected 2 or 3, got {self.dimension}")

    @property
    def states(self) -> tuple[str, ...]:
        return ("x", "y", "z")[: self.dimension]

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("vx", "vy", "vz")[: self.dimension]

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
