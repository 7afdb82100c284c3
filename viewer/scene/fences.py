"""Walls as what is seen of them: pieces that end where other walls, or the scene, begin."""

import numpy as np

from phalanx.arrays import Array
from phalanx.viewer.scene.geometry import unit

HalfSpace = tuple[Array, float]
"""Unit normal out of it, shape (3,), and offset [m]: n·p <= offset."""


def panel(wall: HalfSpace, others: list[HalfSpace], middle: Array, reach: float) -> Array:
    """The corners of a wall's surface, shape (c, 3), where the other walls leave room for it.

    Args:
        wall: whose surface.
        others: walls that cut it off.
        middle: what the scene is around [m], shape (3,).
        reach: half the side of the square that a wall without others is [m].
    """
    normal, offset = wall
    foot = middle + (offset - normal @ middle) * normal
    level = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    across = unit(np.cross(level, normal))
    high = np.cross(normal, across)
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = foot + reach * square @ np.stack([across, high])
    for other in others:
        corners = _clipped(corners, other)
    return corners


def _clipped(corners: Array, keep: HalfSpace) -> Array:
    """A convex polygon's part in a half-space (Sutherland and Hodgman's way)."""
    normal, offset = keep
    beyond = corners @ normal - offset
    found: list[Array] = []
    for k, corner in enumerate(corners):
        before, was = corners[k - 1], beyond[k - 1]
        if (was > 0.0) != (beyond[k] > 0.0):
            found.append(before + was / (was - beyond[k]) * (corner - before))
        if beyond[k] <= 0.0:
            found.append(corner)
    return np.array(found).reshape(-1, 3)
