"""A static convex polygon in the plane as an obstacle, with a smooth distance from its surface."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import casadi as ca
import numpy as np
from annotated_types import Ge, MaxLen, MinLen

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.expressions.rounding import WIDER
from phalanx.theory.models.dynamics import Positive
from phalanx.theory.safety.box import uphill

_SAMPLED = 400
"""Directions of each quarter turn in which C is computed."""


@dataclass(frozen=True)
class Polygon:
    """A static convex polygon in the plane.

    Its distance from p is about the largest of max(0, t_k), where t_k = n_k·p - b_k is the distance
    from a face's line. A smooth m takes the place of max(0, t), at most e / 2 larger, and
    (Σ m⁴ / C)^¼ that of the largest. No direction ψ has Σ max(0, n_k·ψ)⁴ > C: so this is no larger
    than the distance, but for the errors of the m's, which are subtracted.
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

    def intrusion(self, p: ca.SX) -> ca.SX:
        """h = clearance - distance of an output point p [m]."""
        return self.clearance - self.distance(p)

    def reach(self, level: float) -> float:
        """Distance beyond which the intrusion is below a level <= 0 [m]."""
        return (self.clearance - level) * WIDER

    def distance(self, p: ca.SX) -> ca.SX:
        """A smooth lower bound of p's distance from the polygon [m]; below 0 inside."""
        found: ca.SX = self._smooth([ca.dot(ca.DM(n), p) - b for n, b in self._faces], ca.sqrt)
        return found

    def away(self, p: ca.SX) -> ca.SX:
        """Unit vector in which the distance grows."""
        return uphill(self.distance, p)

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
        apart = np.array(self.corners) - np.array(self.center)
        return np.array(self.corners)[np.argsort(np.arctan2(apart[:, 1], apart[:, 0]))]

    @property
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

    @property
    def _largest_sum(self) -> float:
        """C, from directions less than 2 / _SAMPLED apart; the sum's slope is below 1.3 a face."""
        along = np.linspace(-1.0, 1.0, _SAMPLED + 1)
        right = np.column_stack([np.ones_like(along), along])
        directions = np.concatenate([right, -right, right[:, ::-1], -right[:, ::-1]])
        directions /= length(directions)[:, None]
        normals = np.array([n for n, _ in self._faces])
        squares = np.maximum(dot(directions[:, None], normals), 0.0) ** 2
        return float(dot(squares, squares).max()) + 1.3 * len(normals) / _SAMPLED
