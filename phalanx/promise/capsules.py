"""Capsules: all points within a radius of a segment, and how far they are from one another."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length
from phalanx.theory.safety.obstacles import Obstacle

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

    def gaps(self, others: "Capsules") -> Array:
        """Return how far each of the others, m of them, is from all of these at least; (m,) [m]."""
        segments = (sides[:, None] for sides in self[:2]), (sides[None] for sides in others[:2])
        apart = _between(*segments[0], *segments[1])
        gaps = apart - self.radius[:, None] - others.radius[None]
        least: Array = np.minimum.reduce(gaps, axis=0, initial=np.inf) - ROUNDING
        return least

    def gaps_to(self, obstacles: Sequence[Obstacle]) -> Array:
        """Return by how much these keep more than each obstacle's clearance; shape (m,) [m].

        A distance from an obstacle changes by at most 1 m for each metre. So between two points
        it is at least the mean of theirs, less half of the way from one to the other.
        """
        shares = np.linspace(0.0, 1.0, _POINTS)[:, None]
        along = self.end - self.begin
        points = (self.begin[:, None] + shares * along[:, None]).reshape(-1, along.shape[1])
        half_step = 0.5 * length(along) / (_POINTS - 1)
        gaps = np.empty(len(obstacles))
        for k, obstacle in enumerate(obstacles):
            at = obstacle.distances(points).reshape(len(along), _POINTS)
            lowest = np.minimum.reduce(0.5 * (at[:, 1:] + at[:, :-1]), axis=1)
            lowest = lowest - half_step - self.radius
            gaps[k] = np.minimum.reduce(lowest, initial=np.inf) - obstacle.clearance - ROUNDING
        return gaps


def balls(centers: Array, radius: Array) -> Capsules:
    """Return capsules without length; shapes (n, axes), (n,)."""
    return Capsules(centers, centers, radius)


def joined(parts: Sequence[Capsules], axes: int) -> Capsules:
    """Return the capsules of all parts together."""
    if not parts:
        return balls(np.empty((0, axes)), np.empty(0))
    return Capsules(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


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
    apart = length(offset + s[..., None] * first - t[..., None] * second)
    return np.where(inside, apart, np.inf)
