"""Camera views: projections of points, and positions from which all points are seen."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from phalanx.arrays import Array
from phalanx_viewer.scene.kinematics import unit

_FAR = 1e9
"""Farther than any scene reaches [m]."""
_USUAL = 620.0
"""Shorter side of a usual picture [pixels]."""
_SAME_DIRECTION = 1e-4
"""Directions that differ by less are the same [rad]."""


@dataclass(frozen=True)
class View:
    """A perspective camera."""

    position: Array
    """[m], shape (3,)."""
    look_at: Array
    """Point in the middle of the picture [m], shape (3,)."""
    up: Array
    """Shape (3,), not along the line of sight."""
    fov: float
    """Vertical field of view [rad]."""
    aspect: float
    """Width of the picture over its height."""
    pixels: float = _USUAL
    """Length of the picture's shorter side."""

    @property
    def possible(self) -> bool:
        """True if all numbers are finite, and the direction is defined."""
        numbers = np.array([*self.position, *self.look_at, *self.up, self.fov, self.aspect])
        finite = bool((np.abs(numbers) < _FAR).all())
        return finite and 0.0 < self.fov < np.pi and bool(self.axes.any(axis=1).all())

    @cached_property
    def axes(self) -> Array:
        """Unit vectors to the right, up and forward in the picture, shape (3, 3)."""
        forward = unit(self.look_at - self.position)
        right = unit(_cross(forward, self.up))
        return np.stack([right, _cross(right, forward), forward])

    @property
    def distance(self) -> float:
        """Distance from the camera to the point that it looks at [m]."""
        return float(np.linalg.norm(self.look_at - self.position))

    @property
    def enlargement(self) -> float:
        """Factor by which a thing of the same pixels takes more of a picture smaller than usual."""
        # Never less than 1: on a screen with finer pixels there are more of them.
        return max(1.0, _USUAL / self.pixels)

    def spans(self, points: Array) -> Array:
        """Length that fills the shorter side of the picture at each point [m], shape (N,)."""
        depths = np.maximum((points - self.position) @ self.axes[2], 1e-6)
        found: Array = 2.0 * np.tan(self.fov / 2.0) * min(1.0, self.aspect) * depths
        return found

    def project(self, points: Array) -> Array:
        """Project points, shape (N, 3): right and up of the middle, in shorter sides, (N, 2)."""
        found: Array = (points - self.position) @ self.axes[:2].T / self.spans(points)[:, None]
        return found

    def holds(self, points: Array) -> bool:
        """True if all points, shape (N, 3), are in the picture."""
        across, high = np.abs(self.project(points)).T * min(1.0, self.aspect)
        in_front = (points - self.position) @ self.axes[2] > 0.0
        return bool((in_front & (across <= 0.5 * self.aspect) & (high <= 0.5)).all())

    def fitted(self, points: Array, reach: float) -> Self:
        """Return the nearest camera of the same direction that sees balls around points, (N, 3).

        Args:
            points: centres [m].
            reach: radius of the balls [m].
        """
        tan = np.tan(self.fov / 2.0) * np.array([self.aspect, 1.0])
        across, along = points @ self.axes[:2].T, points @ self.axes[2]
        # A ball is left of the picture's right edge if its centre's distance from that plane is at
        # least `reach`; likewise for the other edges. The camera backs off until all are.
        beyond = reach * np.sqrt(1.0 + tan**2) - along[:, None] * tan
        most, least = (beyond + across).max(axis=0), (beyond - across).max(axis=0)
        depth = float((-(most + least) / (2.0 * tan)).min())
        sideways = (most - least) / 2.0
        position = np.array([*sideways, depth]) @ self.axes
        middle = (along.min() + along.max()) / 2.0
        return replace(self, position=position, look_at=position + self.axes[2] * (middle - depth))

    def pulled(self, towards: Array, leash: float) -> Array:
        """The point to look at [m] to keep `towards` within `leash` shorter sides of it."""
        pull = towards - self.look_at
        slack = leash * float(self.spans(self.look_at[None])[0])
        length = max(float(np.linalg.norm(pull)), 1e-9)
        found: Array = self.look_at + max(0.0, 1.0 - slack / length) * pull
        return found

    def moved(self, look_at: Array, distance: float) -> Self:
        """Return a view of another point from another distance [m], in the same direction."""
        return replace(self, look_at=look_at, position=look_at - distance * self.axes[2])


def looks_at(point: Array, position: Array, wxyz: Array) -> bool:
    """True if a camera of this orientation, a unit quaternion, has a point straight ahead."""
    w, x, y, z = wxyz
    forward = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
    return bool(np.linalg.norm(unit(point - position) - forward) < _SAME_DIRECTION)


def _cross(a: Array, b: Array) -> Array:
    """Cross product of two vectors, shapes (3,), in a fifth of NumPy's time."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])
