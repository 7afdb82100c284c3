"""Static obstacles: a sphere or disc, a wall, a box, and a polygon."""

import math
from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from annotated_types import Ge

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import dot, length
from phalanx.theory.expressions.rounding import WIDER
from phalanx.theory.models.dynamics import Positive
from phalanx.theory.safety.box import Box
from phalanx.theory.safety.polygon import Polygon


@dataclass(frozen=True)
class Sphere:
    """A static obstacle; a disc in the plane."""

    center: tuple[float, ...]
    """[m]"""
    clearance: Positive
    """Distance that an output point keeps from the center [m]."""

    def intrusion(self, p: ca.SX) -> ca.SX:
        """h = clearance² - ‖p - center‖² of an output point p [m]."""
        return self.clearance * self.clearance - ca.sumsqr(p - self._center)

    def reach(self, level: float) -> float:
        """Distance beyond which the intrusion is below a level <= 0 [m]."""
        return math.sqrt(self.clearance * self.clearance - level) * WIDER

    def distance(self, p: ca.SX) -> ca.SX:
        """Distance of p from the center [m], as compared with a neighbourhood."""
        return ca.norm_2(p - self._center)

    def away(self, p: ca.SX) -> ca.SX:
        """Unit vector in which the distance grows; undefined at the center."""
        return (p - self._center) / self.distance(p)

    def distances(self, points: Array) -> Array:
        """The same of points [m], shape (s, d); shape (s,)."""
        apart: Array = length(points - np.array(self.center))
        return apart

    @property
    def _center(self) -> ca.SX:
        # The numbers may be symbols, so that one expression serves all spheres.
        return ca.SX(ca.vertcat(*self.center))


@dataclass(frozen=True)
class Wall:
    """A half-space n·p >= offset that is closed to agents; n is a unit normal into it."""

    normal: tuple[float, ...]
    """n; its length does not matter."""
    offset: float
    """n·p of the wall's surface [m]."""
    clearance: Annotated[float, Ge(0)] = 0.0
    """Distance that an output point keeps from the surface [m]."""

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("normal: expected a direction, got zeros only")

    def intrusion(self, p: ca.SX) -> ca.SX:
        """h = n·p + clearance - offset of an output point p [m]."""
        return self.clearance - self.distance(p)

    def reach(self, level: float) -> float:
        """Distance beyond which the intrusion is below a level <= 0 [m]."""
        return (self.clearance - level) * WIDER

    def distance(self, p: ca.SX) -> ca.SX:
        """Signed distance of p from the surface [m]."""
        return self.offset - ca.dot(ca.DM(self.unit_normal), p)

    def away(self, p: ca.SX) -> ca.SX:
        """Unit vector in which the distance grows."""
        return ca.SX(-ca.DM(self.unit_normal))

    def distances(self, points: Array) -> Array:
        """The same of points [m], shape (s, d); shape (s,)."""
        return self.offset - dot(points, self.unit_normal)

    @property
    def unit_normal(self) -> Array:
        """n / ‖n‖, shape (d,)."""
        n: Array = np.array(self.normal) / length(np.array(self.normal))
        return n


Obstacle = Sphere | Wall | Box | Polygon
"""A static obstacle, from which normal agents keep a distance."""
