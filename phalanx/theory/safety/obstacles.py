"""Static obstacles: a sphere or disc, a wall, a box, and a convex polygon.

The distance from a box or polygon has kinks, so that no margin could be proven there. A smooth
lower bound of it takes its place.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Annotated, Any

import casadi as ca
import numpy as np
from annotated_types import Ge, MaxLen, MinLen

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.circular import cos, sin
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.expressions.portable import portable_value
from phalanx.theory.expressions.rounding import WIDER
from phalanx.theory.models.dynamics import Positive

_SAMPLED = 400
"""Directions of each quarter turn in which a polygon's C is computed."""


@dataclass(frozen=True)
class Sphere:
    """A static obstacle; a disc in the plane.

    >>> Sphere(center=(0.0, 0.0), clearance=1.0).intrusion(ca.DM([2, 0]))
    SX(-3)
    """

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
        distance: Array = length(points - np.array(self.center))
        return distance

    @property
    def _center(self) -> ca.SX:
        # The numbers may be symbols, so that one expression serves all spheres.
        return ca.SX(ca.vertcat(*self.center))


class _Solid:
    """An obstacle with a surface; distances from it are signed: below 0 inside."""

    clearance: float

    def intrusion(self, p: ca.SX) -> ca.SX:
        """h = clearance - distance of an output point p [m]."""
        return self.clearance - self.distance(p)

    def reach(self, level: float) -> float:
        """Distance beyond which the intrusion is below a level <= 0 [m]."""
        return (self.clearance - level) * WIDER

    def distance(self, p: ca.SX) -> ca.SX:
        """Distance of p from the surface [m], or a smooth lower bound of it."""
        raise NotImplementedError

    def away(self, p: ca.SX) -> ca.SX:
        """Unit vector in which the distance grows at p, which may be an expression."""
        point = ca.SX.sym("p", p.numel())
        (gradient,) = ca.substitute([ca.gradient(self.distance(point), point)], [point], [p])
        return gradient / ca.norm_2(gradient)


@dataclass(frozen=True)
class Wall(_Solid):
    """A half-space n·p >= offset that is closed to agents; n is a unit normal into it.

    >>> Wall(normal=(1.0, 0.0), offset=5.0).distances(np.array([[2.0, 0.0]]))
    array([3.])
    """

    normal: tuple[float, ...]
    """n; its length does not matter."""
    offset: float
    """n·p of the wall's surface [m]."""
    clearance: Annotated[float, Ge(0)] = 0.0
    """Distance that an output point keeps from the surface [m]."""

    def __post_init__(self) -> None:
        if not any(self.normal):
            raise ValueError("normal: expected a direction, got zeros only")

    def distance(self, p: ca.SX) -> ca.SX:
        return self.offset - ca.dot(ca.DM(self.unit_normal), p)

    def away(self, p: ca.SX) -> ca.SX:
        return ca.SX(-ca.DM(self.unit_normal))

    def distances(self, points: Array) -> Array:
        """The distance of points [m], shape (s, d); shape (s,)."""
        return self.offset - dot(points, self.unit_normal)

    @property
    def unit_normal(self) -> Array:
        """n / ‖n‖, shape (d,)."""
        n: Array = np.array(self.normal) / length(np.array(self.normal))
        return n


@dataclass(frozen=True)
class Box(_Solid):
    """A static box, in the plane or in space, turned about the vertical axis.

    Its distance from p is ‖e‖, where e_k = max(0, |q_k| - s_k / 2) and q is p in the box's axes.
    A smooth m takes the maximum's place, with max(0, t) < m(t) <= max(0, t) + ε / 2, and the
    largest sum of these errors is subtracted.

    >>> Box(center=(0.0, 0.0), size=(2.0, 2.0)).distances(np.array([[3.0, 0.0]])).round(2)
    array([1.86])
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

    def distance(self, p: ca.SX) -> ca.SX:
        q = ca.vertsplit(ca.DM(self._axes) @ (p - ca.DM(list(self.center))))
        distance: ca.SX = self._smooth(q, ca.sqrt)
        return distance

    def distances(self, points: Array) -> Array:
        """The distance of points [m], shape (s, d); shape (s,)."""
        apart = points - np.array(self.center)
        distance: Array = self._smooth([dot(apart, axis) for axis in self._axes], np.sqrt)
        return distance

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

    @cached_property
    def _axes(self) -> Array:
        """Directions of the sides, shape (d, d)."""
        axes = np.eye(len(self.center))
        c, s = portable_value(cos, self.angle), portable_value(sin, self.angle)
        axes[:2, :2] = [[c, s], [-s, c]]
        return axes

    def _corner(self, signs: tuple[float, ...]) -> tuple[float, ...]:
        local = np.array(signs) * np.array(self.size)
        return tuple((np.array(self.center) + dot(self._axes.T, local)).tolist())


@dataclass(frozen=True)
class Polygon(_Solid):
    """A static convex polygon in the plane.

    Its distance from p is about the largest of max(0, t_k), where t_k = n_k·p - b_k is the distance
    from a face's line. A smooth m takes the place of max(0, t), at most e / 2 larger, and
    (Σ m⁴ / C)^¼ that of the largest. No direction ψ has Σ max(0, n_k·ψ)⁴ > C: so this is no larger
    than the distance, but for the errors of the m's, which are subtracted.

    >>> Polygon(((0.0, 0.0), (2.0, 0.0), (0.0, 2.0))).distances(np.array([[0.5, -1.0]])).round(2)
    array([0.89])
    """

    corners: Annotated[tuple[tuple[float, float], ...], MinLen(3), MaxLen(8)]
    """[m], in any order."""
    clearance: Annotated[float, Ge(0)] = 0.0
    """Distance that an output point keeps from the surface [m]; up to 1.3 times as far at corners,
    or more if several lie nearly on a line."""
    rounding: Positive = 0.1
    """Output points keep up to this distance more [m]."""

    def __post_init__(self) -> None:
        around = self._around
        ahead = np.roll(around, -1, axis=0) - around
        after = np.roll(ahead, -1, axis=0)
        with np.errstate(all="ignore"):
            turns = ahead[:, 0] * after[:, 1] - ahead[:, 1] * after[:, 0]
        if not (turns > 0.0).all():
            raise ValueError("corners: expected those of a convex polygon, no three on a line")

    def distance(self, p: ca.SX) -> ca.SX:
        found: ca.SX = self._smooth([ca.dot(ca.DM(n), p) - b for n, b in self._faces], ca.sqrt)
        return found

    def distances(self, points: Array) -> Array:
        """The distance of points [m], shape (s, d); shape (s,)."""
        found: Array = self._smooth([dot(points, n) - b for n, b in self._faces], np.sqrt)
        return found

    def edges(self) -> list[tuple[tuple[float, ...], ...]]:
        """Ends of each edge [m], for drawing."""
        corners = [tuple(corner) for corner in self._around.tolist()]
        return list(zip(corners, [*corners[1:], corners[0]], strict=True))

    @property
    def center(self) -> tuple[float, ...]:
        """The mean of its corners [m]."""
        return tuple((np.add.reduce(np.array(self.corners)) / len(self.corners)).tolist())

    def _smooth(self, t: Sequence[Any], sqrt: Callable[[Any], Any]) -> Any:
        """The distance of points from their distances to all faces: expressions or arrays."""
        e = 2.0 * self.rounding / math.sqrt(math.sqrt(len(t)))
        squares = [((each + sqrt(each**2 + e * e)) / 2) ** 2 for each in t]
        return sqrt(sqrt(added(m2**2 for m2 in squares) / self._largest_sum)) - self.rounding

    @property
    def _around(self) -> Array:
        """Its corners counterclockwise, shape (k, 2)."""
        offsets = np.array(self.corners) - np.array(self.center)
        return np.array(self.corners)[np.argsort(np.arctan2(offsets[:, 1], offsets[:, 0]))]

    @cached_property
    def _faces(self) -> list[tuple[Array, float]]:
        """Unit normals n and offsets b of its edges, and of lines through its acute corners."""
        corners = self._around
        ahead = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([ahead[:, 1], -ahead[:, 0]]) / length(ahead)[:, None]
        faces = []
        for corner, before, n in zip(corners, np.roll(normals, 1, axis=0), normals, strict=True):
            if dot(before, n) < -1e-9:
                between = (before + n) / length(before + n)
                faces.append((between, float(dot(between, corner))))
            faces.append((n, float(dot(n, corner))))
        return faces

    @cached_property
    def _largest_sum(self) -> float:
        """C, from directions less than 2 / _SAMPLED apart; the sum's slope is below 1.3 a face."""
        along = np.linspace(-1.0, 1.0, _SAMPLED + 1)
        right = np.column_stack([np.ones_like(along), along])
        directions = np.concatenate([right, -right, right[:, ::-1], -right[:, ::-1]])
        directions /= length(directions)[:, None]
        normals = np.array([n for n, _ in self._faces])
        squares = np.maximum(dot(directions[:, None], normals), 0.0) ** 2
        return float(dot(squares, squares).max()) + 1.3 * len(normals) / _SAMPLED


Obstacle = Sphere | Wall | Box | Polygon
"""A static obstacle, from which normal agents keep a distance."""
