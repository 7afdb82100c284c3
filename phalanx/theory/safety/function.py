"""Safe-set functions h of two agents, or of an agent and an obstacle; safe is h <= 0."""

from dataclasses import dataclass
from math import sqrt
from typing import Annotated, Protocol, runtime_checkable

import casadi as ca
from annotated_types import Gt

from phalanx.theory.safety.obstacles import WIDER, Obstacle

Positive = Annotated[float, Gt(0)]


@dataclass(frozen=True)
class Body:
    """One agent as a safe-set function sees it."""

    x: ca.SX
    """State, shape (n,)."""
    p: ca.SX
    """Output position [m], shape (2,) or (3,)."""
    states: tuple[str, ...] = ()
    """Names of its dynamics' states, shape (n,)."""
    adversary: bool = False


@runtime_checkable
class SafeSetFunction(Protocol):
    """h as CasADi expressions; a scenario names it ``package.module:Name``."""

    def between(self, a: Body, b: Body) -> ca.SX:
        """h_ab, scalar, of a normal agent a and any other agent b."""

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        """h of a normal agent a and an obstacle, scalar.

        A sphere of symbols comes first: one expression serves all spheres. If that fails, or is
        another h than that of the numbers, every sphere gets an expression of its own.
        """


@dataclass(frozen=True)
class Separation:
    """h = R² - ‖p_a - p_b‖²: the output points stay R apart."""

    radius: Positive
    """R between agents [m]; R_c + 2b in the paper's Simulation 1."""
    unit = "m²"

    def between(self, a: Body, b: Body) -> ca.SX:
        return self.radius * self.radius - ca.sumsqr(a.p - b.p)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.intrusion(a.p)

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        if obstacle is not None:
            return obstacle.reach(level)
        return sqrt(self.radius * self.radius - level) * WIDER
