"""The fallback *exit*: to move on for ever with one velocity w, which all normal agents share.

In a frame that moves with w this is *hold*: tubes, W and the rule are the same there, for inputs
that lack what it takes to keep w. A chaser of a speed of at most s < ‖w‖ moves there by -w and at
most s more: for ever it stays in the cone {a - w t + r : t >= 0, ‖r‖ <= s t} of its place a. The
distance of a set from that is at least n·(y - a) for any unit vector n with n·w >= s and all y of
the set. One that is as fast as w reaches everything in the end; within a time T it is farther than
n·(y - a) + (n·w - s) T, of which the best n points to y + w T from a.
"""

from typing import NamedTuple

import numpy as np

from phalanx.promise.capsules import ROUNDING, Capsules
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length

_FAR = 1e4
"""Length of an exit that obstacles are kept from [m]."""


class Chasers(NamedTuple):
    """Members that may chase, n of them.

    >>> behind = Chasers(np.array([[-2.0, 0.0]]), np.zeros(1), np.array([1.0]), np.zeros(1))
    >>> place = Capsules(np.zeros((1, 2)), np.zeros((1, 2)), np.zeros(1))
    >>> behind.gaps(place, np.array([1.5, 0.0])).round(3)
    array([2.])
    """

    places: Array
    """a, shape (n, axes) [m]."""
    offsets: Array
    """How much farther a first speed brings them, shape (n,) [m]."""
    speeds: Array
    """s, shape (n,) [m/s]."""
    times: Array
    """T, for which one that is as fast as the exit is counted, shape (n,) [s]."""

    def gaps(self, capsules: Capsules, velocity: Array) -> Array:
        """Return how far each chaser stays from all capsules, at least; (n,) [m].

        For ever, or for its time if it is as fast as the exit.
        """
        # Of no bound on a speed, the product with no time is 0.
        fastest, speeds = float(length(velocity)), np.minimum(self.speeds, 1e200)
        slower, shares = speeds < fastest, speeds / max(fastest, 1e-100)
        share = np.where(slower, shares, -1.0)[:, None, None]
        time = np.where(slower, 0.0, self.times)[:, None]
        points = np.stack([capsules.begin, capsules.end])
        ways = points[:, None] - self.places[:, None]  # (2, n, capsules, axes)
        ends = ways + time[..., None] * velocity
        normals = _towards(np.concatenate([ends, ends[:1] + ends[1:]]), velocity, share)
        distances = np.minimum.reduce(dot(ways[:, None], normals[None]))
        nearer = np.minimum(dot(normals, velocity) - speeds[:, None], 0.0) * time
        gaps = np.maximum.reduce(distances + nearer) - capsules.radius
        least: Array = np.minimum.reduce(gaps, axis=1, initial=np.inf) - ROUNDING
        return least - self.offsets


def _towards(ways: Array, velocity: Array, share: Array) -> Array:
    """The unit vectors n nearest to these ways with n·w / ‖w‖ at least a share."""
    ahead = velocity / max(float(length(velocity)), 1e-300)
    size = length(ways)[..., None]
    units = np.where(size > 0.0, ways / np.where(size > 0.0, size, 1.0), ahead)
    along = dot(units, ahead)[..., None]
    across = units - along * ahead
    width = length(across)[..., None]
    across = across / np.where(width > 0.0, width, 1.0)
    # Straight behind, all sides are as far; ahead is allowed too.
    edge = share * ahead + np.sqrt(1.0 - share * share) * across
    normals: Array = np.where(along >= share, units, np.where(width > 0.0, edge, ahead))
    return normals


def swept(capsules: Capsules, velocity: Array) -> Capsules:
    """Return capsules that contain all that these pass on their exit."""
    middle = 0.5 * (capsules.begin + capsules.end)
    half = 0.5 * length(capsules.end - capsules.begin)
    ahead = velocity / float(length(velocity))
    return Capsules(middle, middle + _FAR * ahead, capsules.radius + half)
