"""Safe-set functions h of two agents, of an agent and an obstacle, or of an agent alone (limits).

Safe is h <= 0. Those of pairs have a proven reach, so that distant pairs can be left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.rounding import WIDER
from phalanx.theory.expressions.user_methods import declare_scalar
from phalanx.theory.models.dynamics import Positive
from phalanx.theory.safety.obstacles import Box, Obstacle, Polygon, Sphere


@dataclass(frozen=True)
class Body:
    """One agent as an argument of a safe-set function.

    >>> p = ca.DM([0, 0])
    >>> Body(x=p, p=p, states=("x", "y")).adversary
    False
    """

    x: ca.SX
    """State, shape (n,)."""
    p: ca.SX
    """Output position [m], shape (2,) or (3,)."""
    states: tuple[str, ...] = ()
    """Names of its dynamics' states, shape (n,)."""
    adversary: bool = False


@runtime_checkable
class SafeSetFunction(Protocol):
    """h as CasADi expressions; a scenario names it ``package.module:Name``.

    >>> class Loose:
    ...     def between(self, a, b):
    ...         return 1.0 - ca.norm_2(a.p - b.p)
    ...     def to_obstacle(self, a, obstacle):
    ...         return obstacle.intrusion(a.p)
    >>> isinstance(Loose(), SafeSetFunction)
    True
    """

    def between(self, a: Body, b: Body) -> ca.SX:
        """h_ab, scalar, of a normal agent a and any other agent b."""

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        """h of a normal agent a and an obstacle, scalar.

        Called first with a sphere of symbols, for one expression that serves all spheres. If that
        raises, or gives another h than numbers do, every sphere has an expression of its own.
        """


@dataclass(frozen=True)
class Separation:
    """h = R² - ‖p_a - p_b‖²: the output points stay R apart.

    >>> p, q = ca.DM([0, 0]), ca.DM([3, 4])
    >>> Separation(radius=1.0).between(Body(p, p), Body(q, q))
    DM(-24)
    """

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
        return math.sqrt(self.radius * self.radius - level) * WIDER


@dataclass(frozen=True)
class Distance:
    """h = R - ‖p_a - p_b‖: the same safe set as R² - ‖p_a - p_b‖², with a gradient of one length.

    Far away the disturbance costs h no more than nearby, so that a weak α_1 can pay for it.
    Smooth except where two output points meet.

    >>> p, q = ca.DM([0, 0]), ca.DM([3, 4])
    >>> Distance(radius=1.0).between(Body(p, p), Body(q, q))
    DM(-4)
    """

    radius: Positive
    """R between agents [m]."""
    unit = "m"

    def between(self, a: Body, b: Body) -> ca.SX:
        return self.radius - ca.norm_2(a.p - b.p)

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.clearance - obstacle.distance(a.p)

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        return ((self.radius if obstacle is None else obstacle.clearance) - level) * WIDER


@dataclass(frozen=True)
class HeadingAware:
    """h = R + κ (1 - cos γ) - d for unicycles: farther apart, the less a heading points away.

    γ is the angle between a normal agent's heading and the direction away from the other; for two
    normal agents cos γ is the mean of both, so that each can keep its half. Side-on a unicycle can
    hardly change d, but turning changes h: ∂h/∂θ is κ. Along the line of sight driving changes d at
    full speed, forwards or backwards. With sin² γ, the same both ways, turning would change nothing
    side-on; so only headings away from the other lower h. Smooth except where d = 0.

    >>> x, p, q = ca.DM([0, 0, 0]), ca.DM([0, 0]), ca.DM([2, 0])
    >>> ahead = Body(q, q, adversary=True)
    >>> HeadingAware(radius=1.0, kappa=0.5).between(Body(x, p, ("x", "y", "theta")), ahead)
    DM(0)
    """

    radius: Positive
    """R between agents [m], with headings straight away from the other."""
    kappa: Positive
    """κ [m]: additional distance when side-on; twice that head-on."""
    unit = "m"

    def between(self, a: Body, b: Body) -> ca.SX:
        distance = ca.norm_2(a.p - b.p)
        away = (a.p - b.p) / distance
        cosine = _heading(a, away)
        if not b.adversary:
            cosine = (cosine + _heading(b, -away)) / 2
        return self.radius + self.kappa * (1 - cosine) - distance

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        cosine = _heading(a, obstacle.away(a.p))
        return obstacle.clearance + self.kappa * (1 - cosine) - obstacle.distance(a.p)

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        keep_out = self.radius if obstacle is None else obstacle.clearance
        return (keep_out + 2.0 * self.kappa - level) * WIDER


def _heading(body: Body, away: ca.SX) -> ca.SX:
    """cos γ between a unicycle's heading and a direction. Raises ValueError for other dynamics."""
    if body.states != ("x", "y", "theta"):
        raise ValueError(
            "safety.function: heading-aware needs normal agents that are unicycles, with states "
            f"x, y, theta; got {', '.join(body.states)}"
        )
    return ca.dot(ca.vertcat(ca.cos(body.x[2]), ca.sin(body.x[2])), away)


_PROVEN = (Separation, Distance, HeadingAware)
_METHODS = ("between", "to_obstacle", "reach")


class Reaching(Protocol):
    """A safe-set function with h below any level, far enough away."""

    def reach(self, level: float, obstacle: Obstacle | None = None) -> float:
        """Distance beyond which h is below a level <= 0 [m].

        Between the output points of any two agents; or `obstacle.distance` of an agent's.
        """


def proven_reach(function: SafeSetFunction) -> Reaching | None:
    """The function, if its h and its reach are those of a class above; None for a user's own.

    With a reach that is too short, unsafe pairs would be missing in verdict and certificates.
    """
    for proven in _PROVEN:
        same = (getattr(type(function), name, None) is getattr(proven, name) for name in _METHODS)
        if isinstance(function, proven) and all(same):
            return function
    return None


Line = list[tuple[float, ...]]

_CORNERS = 96


@runtime_checkable
class Limit(Protocol):
    """A condition on each normal agent alone; a scenario names it ``package.module:Name``.

    >>> class Ceiling:
    ...     def alone(self, a):
    ...         return a.p[2] - 10.0
    >>> isinstance(Ceiling(), Limit)
    True
    """

    def alone(self, a: Body) -> ca.SX:
        """h of a normal agent, scalar; q as for pairs."""


@runtime_checkable
class Drawable(Protocol):
    """A limit that can be drawn.

    >>> isinstance(Fence(center=(0.0, 0.0), radius=8.0), Drawable)
    True
    """

    def outline(self) -> Sequence[Line]:
        """Lines through points [m], in the plane or in space; a closed one ends where it began."""


@dataclass(frozen=True)
class Fence:
    """h = (‖p - c‖² - R²) / 2R: output points stay in a disc, or a ball.

    About the distance from the fence where that is small, and smooth everywhere.

    >>> p = ca.DM([9, 0])
    >>> Fence(center=(1.0, 0.0), radius=8.0).alone(Body(p, p))
    DM(0)
    """

    center: tuple[float, ...]
    """c [m]"""
    radius: Positive
    """R [m]"""
    unit = "m"

    def alone(self, a: Body) -> ca.SX:
        if len(self.center) != a.p.numel():
            raise ValueError(f"center: expected {a.p.numel()} axes, got {len(self.center)}")
        square = ca.sumsqr(a.p - ca.DM(list(self.center)))
        return (square - self.radius * self.radius) / (2.0 * self.radius)

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


def outlines(static: Sequence[Static]) -> list[Line]:
    """Lines of limits that can be drawn, then the edges of boxes and polygons, points in [m]."""
    limits = [side.limit for side in static if isinstance(side, Boundary)]
    lines = [line for limit in limits if isinstance(limit, Drawable) for line in limit.outline()]
    boxes = [side for side in static if isinstance(side, Box | Polygon)]
    return lines + [list(edge) for box in boxes for edge in box.edges()]


def static_h(function: SafeSetFunction, a: Body, static: Static) -> ca.SX:
    """h of a normal agent and something static, scalar."""
    if isinstance(static, Boundary):
        return static.limit.alone(a)
    return function.to_obstacle(a, static)


def _numbers(obstacle: Obstacle) -> list[ca.SX]:
    """An obstacle's numbers, which may be symbols."""
    if not isinstance(obstacle, Sphere):
        return []
    return [ca.SX(ca.vertcat(*obstacle.center, obstacle.clearance))]


declare_scalar(SafeSetFunction, "between", lambda a, b: [a.x, b.x])
declare_scalar(SafeSetFunction, "to_obstacle", lambda a, obstacle: [a.x, *_numbers(obstacle)])
declare_scalar(Limit, "alone", lambda a: [a.x])


def static_reach(function: Reaching, level: float, static: Static) -> float:
    """Distance beyond which h is below a level <= 0 [m]; infinite for a limit."""
    return math.inf if isinstance(static, Boundary) else function.reach(level, static)
