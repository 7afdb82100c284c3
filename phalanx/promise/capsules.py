"""Capsules: all points within a radius of a segment, and how far they are from one another."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length
from phalanx.theory.safety.obstacles import Obstacle, Sphere

ROUNDING = 1e-6
"""Allowed for rounding in every distance [m]."""
_POINTS = 65
"""Points of a segment at which the distance from an obstacle is taken."""


class Capsules(NamedTuple):
    """Sets {a + s (b - a) + r : 0 <= s <= 1, ‖r‖ <= radius}, n of them.

    >>> disc = Capsules(np.zeros((1, 2)), np.zeros((1, 2)), np.array([1.0]))
    >>> disc.gaps(disc._replace(begin=np.array([[4.0, 0.0]]), end=np.array([[4.0, 3.0]])))
    array([1.999999])
    """

    begin: Array
    """a, shape (n, axes) [m]."""
    end: Array
    """b, shape (n, axes) [m]."""
    radius: Array
    """shape (n,) [m]."""

    def gaps(self, others: "Capsules", enough: float = np.inf) -> Array:
        """Return how far each of the others, m of them, is from all of these at least; (m,) [m].

        enough: a distance [m]; gaps beyond it may be larger than what is returned.
        """
        if not len(self.radius):
            return np.full(len(others.radius), np.inf)
        if enough == np.inf:
            return self._nearest(others)
        # Most are so far that balls around both are enough.
        centers, radii = others.balls_around()
        center = self.begin[0]
        gaps: Array = length(centers - center) - radii - self.reach(center) - ROUNDING
        near = np.flatnonzero(~(gaps >= enough))
        if len(near):
            begin, end, radius = (side[near] for side in others)
            points = others.begin is others.end
            gaps[near] = self._nearest(Capsules(begin, begin if points else end, radius))
        return gaps

    def reach(self, p: Array) -> float:
        """Return a bound on how far any of their points is from p, shape (axes,) [m]."""
        centers, radii = self.balls_around()
        return float(np.maximum.reduce(length(centers - p) + radii))

    def balls_around(self) -> tuple[Array, Array]:
        """Return centers, shape (n, axes), and radii of balls around each."""
        if self.begin is self.end:
            return self.begin, self.radius
        return 0.5 * (self.begin + self.end), 0.5 * length(self.end - self.begin) + self.radius

    def _nearest(self, others: "Capsules") -> Array:
        begin, end = self.begin[:, None], self.end[:, None]
        if others.begin is others.end:
            distances = _to_segment(others.begin, begin, end)
        else:
            distances = _between(begin, end, others.begin, others.end)
        gaps = distances - self.radius[:, None] - others.radius
        least: Array = np.minimum.reduce(gaps, axis=0) - ROUNDING
        return least


class Statics:
    """Static obstacles, each with the clearance that is kept from it."""

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        """Keep spheres as balls, for all of which one call does."""
        self._count = len(obstacles)
        spheres = {k: o for k, o in enumerate(obstacles) if isinstance(o, Sphere)}
        self._solids = {k: o for k, o in enumerate(obstacles) if not isinstance(o, Sphere)}
        self._numbers = [*spheres]
        centers = np.array([o.center for o in spheres.values()])
        self._spheres = balls(centers, np.array([o.clearance for o in spheres.values()]))

    def gap(self, p: Array) -> float:
        """Return by how much a point, shape (axes,), keeps more than each clearance [m]."""
        least = np.inf
        if self._numbers:
            gaps = length(self._spheres.begin - p) - self._spheres.radius
            least = float(np.minimum.reduce(gaps))
        for obstacle in self._solids.values():
            least = min(float(obstacle.distances(p[None])[0]) - obstacle.clearance, least)
        return least - ROUNDING

    def gaps(self, capsules: Capsules) -> Array:
        """Return by how much capsules keep more than each clearance at least; (m,) [m].

        A distance from an obstacle changes by at most 1 m for each metre. So between two points
        it is at least the mean of theirs, less half of the way from one to the other.
        """
        gaps = np.empty(self._count)
        if self._numbers:
            gaps[self._numbers] = capsules.gaps(self._spheres)
        for k, obstacle in self._solids.items():
            gap = _least(capsules, obstacle, 2)
            # Most are far: there the ends are enough.
            gaps[k] = gap if gap >= 0.0 else _least(capsules, obstacle, _POINTS)
        return gaps


def _least(capsules: Capsules, obstacle: Obstacle, count: int) -> float:
    """The gap to an obstacle, from so many points of each segment."""
    shares = np.linspace(0.0, 1.0, count)[:, None]
    along = capsules.end - capsules.begin
    points = (capsules.begin[:, None] + shares * along[:, None]).reshape(-1, along.shape[1])
    at = obstacle.distances(points).reshape(len(along), count)
    between = np.minimum.reduce(0.5 * (at[:, 1:] + at[:, :-1]), axis=1)
    least = between - 0.5 * length(along) / (count - 1) - capsules.radius
    return float(least.min(initial=np.inf)) - obstacle.clearance - ROUNDING


def balls(centers: Array, radius: Array) -> Capsules:
    """Return capsules without length; shapes (n, axes), (n,)."""
    return Capsules(centers, centers, radius)


def joined(parts: Sequence[Capsules], axes: int) -> Capsules:
    """Return the capsules of all parts together."""
    if not parts:
        return balls(np.empty((0, axes)), np.empty(0))
    begin, end, radius = (np.concatenate(sides) for sides in zip(*parts, strict=True))
    return Capsules(begin, begin if all(p.begin is p.end for p in parts) else end, radius)


def _between(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The distance of segments [a, b] and [c, d]: at an end of one, or where both are crossed."""
    ends = [_to_segment(p, c, d) for p in (a, b)] + [_to_segment(p, a, b) for p in (c, d)]
    return np.minimum(np.minimum.reduce(ends), _of_lines(a, b, c, d))


def _to_segment(p: Array, a: Array, b: Array) -> Array:
    """The distance of points from segments [a, b]."""
    along = b - a
    size = dot(along, along)
    share = dot(p - a, along) / np.where(size > 0.0, size, 1.0)
    return length(p - a - np.clip(share, 0.0, 1.0)[..., None] * along)


def _of_lines(a: Array, b: Array, c: Array, d: Array) -> Array:
    """The distance of the lines where their nearest points are on both segments; else infinite."""
    first, second, offset = b - a, d - c, a - c
    one, mixed, two = dot(first, first), dot(first, second), dot(second, second)
    one_off, two_off, flat = dot(first, offset), dot(second, offset), one * two - mixed * mixed
    divisor = np.where(flat > 0.0, flat, 1.0)
    s, t = (mixed * two_off - two * one_off) / divisor, (one * two_off - mixed * one_off) / divisor
    inside = (flat > 0.0) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    distances = length(offset + s[..., None] * first - t[..., None] * second)
    return np.where(inside, distances, np.inf)
