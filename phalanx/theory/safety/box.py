"""A static box as an obstacle, with a smooth distance from its surface."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Annotated, Any

import casadi as ca
import numpy as np
from annotated_types import Ge

from phalanx.arrays import Array
from phalanx.theory.expressions.circular import cos, sin
from phalanx.theory.expressions.exact import added, dot
from phalanx.theory.expressions.portable import portable_value
from phalanx.theory.expressions.rounding import WIDER
from phalanx.theory.models.dynamics import Positive


@dataclass(frozen=True)
class Box:
    """A static box, in the plane or in space, turned about the vertical axis.

    Its distance from p is ‖e‖, where e_k = max(0, |q_k| - s_k / 2) and q is p in the box's axes.
    The maximum has a kink, so that no margin could be proven there. A smooth m takes its place,
    with max(0, t) < m(t) <= max(0, t) + ε / 2, and the largest sum of these errors is subtracted.
    """

    center: tuple[float, ...]
    """[m]"""
    size: tuple[Positive, ...]
    """s: length of its sides [m]."""
    clearance: Annotated[float, Ge(0)] = 0.0
    """Distance that an output point keeps from the surface [m]."""
    angle: float = 0.0
    """Angle from the x axis to the first side [rad]."""
    rounding: Positive = 0.1
    """ε [m]: output points keep up to √d ε more, in d dimensions."""

    def __post_init__(self) -> None:
        if len(self.size) != len(self.center):
            raise ValueError(f"size: expected {len(self.center)} sides, got {len(self.size)}")

    def intrusion(self, p: ca.SX) -> ca.SX:
        """h = clearance - distance of an output point p [m]."""
        return self.clearance - self.distance(p)

    def reach(self, level: float) -> float:
        """Distance beyond which the intrusion is below a level <= 0 [m]."""
        return (self.clearance - level) * WIDER

    def distance(self, p: ca.SX) -> ca.SX:
        """A smooth lower bound of p's distance from the box [m]; below 0 inside."""
        q = ca.vertsplit(ca.DM(self._axes) @ (p - ca.DM(list(self.center))))
        found: ca.SX = self._smooth(q, ca.sqrt)
        return found

    def away(self, p: ca.SX) -> ca.SX:
        """Unit vector in which the distance grows; undefined at the center."""
        return uphill(self.distance, p)

    def distances(self, points: Array) -> Array:
        """The distance of points [m], shape (s, d); shape (s,)."""
        apart = points - np.array(self.center)
        found: Array = self._smooth([dot(apart, axis) for axis in self._axes], np.sqrt)
        return found

    def edges(self) -> list[tuple[tuple[float, ...], ...]]:
        """Ends of each edge [m], for drawing."""
        signs = list(product((-0.5, 0.5), repeat=len(self.size)))
        return [
            (self._corner(a), self._corner(b))
            for a, b in combinations(signs, 2)
            if sum(x != y for x, y in zip(a, b, strict=True)) == 1
        ]

    def _smooth(self, q: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        """The distance of points with these coordinates: expressions or arrays."""

        e2 = self.rounding * self.rounding
        squares = [
            ((sqrt((c - side / 2) ** 2 + e2) + sqrt((c + side / 2) ** 2 + e2) - side) / 2) ** 2
            for c, side in zip(q, self.size, strict=True)
        ]
        # Both faces of a side err by ε together, at most.
        return sqrt(added(squares)) - math.sqrt(len(q)) * self.rounding

    @property
    def _axes(self) -> Array:
        """Directions of the sides, shape (d, d)."""
        axes = np.eye(len(self.center))
        c, s = portable_value(cos, self.angle), portable_value(sin, self.angle)
        axes[:2, :2] = [[c, s], [-s, c]]
        return axes

    def _corner(self, signs: tuple[float, ...]) -> tuple[float, ...]:
        local = np.array(signs) * np.array(self.size)
        return tuple((np.array(self.center) + dot(self._axes.T, local)).tolist())


def uphill(distance: Callable[[ca.SX], ca.SX], p: ca.SX) -> ca.SX:
    """Unit vector in which a distance grows, at p, which may be an expression."""
    point = ca.SX.sym("p", p.numel())
    (gradient,) = ca.substitute([ca.gradient(distance(point), point)], [point], [p])
    return gradient / ca.norm_2(gradient)
