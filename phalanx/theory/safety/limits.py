"""Limits, safe-set functions of one agent alone such as a fence; and h with anything static."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.user_methods import call_for_expression
from phalanx.theory.models.dynamics import Positive
from phalanx.theory.safety.function import Body, Reaching, SafeSetFunction
from phalanx.theory.safety.obstacles import Obstacle

Line = list[tuple[float, ...]]

_CORNERS = 96


@runtime_checkable
class Limit(Protocol):
    """A condition on each normal agent alone; a scenario names it ``package.module:Name``."""

    def alone(self, a: Body) -> ca.SX:
        """h of a normal agent, scalar; q as for pairs."""


@runtime_checkable
class Drawable(Protocol):
    """A limit that can be drawn."""

    def outline(self) -> Sequence[Line]:
        """Lines through points [m], in the plane or in space; a closed one ends where it began."""


@dataclass(frozen=True)
class Fence:
    """h = (‖p - c‖² - R²) / 2R: output points stay in a disc, or a ball.

    About the distance from the fence where that is small, and smooth everywhere.
    """

    center: tuple[float, ...]
    """c [m]"""
    radius: Positive
    """R [m]"""
    unit = "m"

    def alone(self, a: Body) -> ca.SX:
        if len(self.center) != a.p.numel():
            raise ValueError(f"center: expected {a.p.numel()} axes, got {len(self.center)}")
        apart = ca.sumsqr(a.p - ca.DM(list(self.center)))
        return (apart - self.radius * self.radius) / (2.0 * self.radius)

    def outline(self) -> Sequence[Line]:
        axes = range(len(self.center))
        return [self._circle(a, b) for a in axes for b in axes if a < b]

    def _circle(self, a: int, b: int) -> Line:
        """The circle around the centre in the plane of two axes."""
        points = []
        for angle in np.linspace(0.0, 2.0 * math.pi, _CORNERS + 1).tolist():
            point = list(self.center)
            point[a] += self.radius * math.cos(angle)
            point[b] += self.radius * math.sin(angle)
            points.append(tuple(point))
        return points


@dataclass(frozen=True)
class Band:
    """h = ((s - m)² - w²) / 2w: a state s, such as an altitude, stays within m - w and m + w."""

    state: str
    """Name of the state."""
    low: float
    """m - w, in the state's unit."""
    high: float
    """m + w"""

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"high: expected more than low = {self.low}, got {self.high}")

    def alone(self, a: Body) -> ca.SX:
        if self.state not in a.states:
            raise ValueError(f"state: expected one of {', '.join(a.states)}, got {self.state}")
        middle, half = (self.low + self.high) / 2.0, (self.high - self.low) / 2.0
        s = a.x[a.states.index(self.state)]
        return ((s - middle) ** 2 - half * half) / (2.0 * half)


@dataclass(frozen=True)
class Boundary:
    """A limit as the other side of a pair, like an obstacle at distance 0."""

    limit: Limit

    def distance(self, p: ca.SX) -> ca.SX:
        """Distance of an output point [m]: 0, since a limit counts everywhere."""
        return ca.SX(0)

    def distances(self, points: Array) -> Array:
        """Distances of points [m], shape (s, d); shape (s,)."""
        return np.zeros(len(points))


Static = Obstacle | Boundary


def static_h(function: SafeSetFunction, a: Body, static: Static, parameters: ca.SX) -> ca.SX:
    """h of a normal agent and something static, scalar.

    parameters: symbols in place of an obstacle's numbers.

    Raises:
        MistakenMethodError: the function or the limit failed, or returned something else.
    """
    if isinstance(static, Boundary):
        return call_for_expression(static.limit, "alone", [()], a, symbols=[a.x])
    return call_for_expression(function, "to_obstacle", [()], a, static, symbols=[a.x, parameters])


def static_reach(function: Reaching, level: float, static: Static) -> float:
    """Distance beyond which h is below a level <= 0 [m]; infinite for a limit."""
    return math.inf if isinstance(static, Boundary) else function.reach(level, static)
