"""Sets of peers' references: everything that can have become of a state heard some time ago.

On each axis the ends of p and of v are reached by one input, so a box of both loses nothing.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import moved
from phalanx.knowledge.motion import Motions
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.exact import length


class HeardState(NamedTuple):
    """The newest state heard of a peer."""

    t: float
    """Time of its sample [s]."""
    x: Array
    """Its sampled state (p, v), shape (2 axes,)."""
    z: Array
    """Its reference, likewise; the same where nothing disturbs it."""
    t_apply: float
    """Time at which its announced input applies [s]."""
    u: Array
    """Its announced input, shape (axes,)."""


class PeerSet(NamedTuple):
    """A box that contains a peer's reference.

    >>> PeerSet(np.array([0.0, -1.0]), np.array([2.0, 1.0]), age=0.1).centre
    array([1., 0.])
    """

    low: Array
    """of (p, v), shape (2 axes,)"""
    high: Array
    age: float
    """Time since the sample that it was made from [s]."""

    @property
    def centre(self) -> Array:
        middle: Array = 0.5 * (self.low + self.high)
        return middle


class Boxes(NamedTuple):
    """Boxes of several peers' (p, v)."""

    low: Array
    """shape (n, 2 axes)"""
    high: Array

    def of(self, indices: Index) -> "Boxes":
        """Return some of them, in this order."""
        return Boxes(self.low[indices], self.high[indices])

    def after(self, time: Array, motions: Motions, least: Array, most: Array) -> "Boxes":
        """Return the boxes a time later, shape (n,), under inputs from least to most."""
        factors = motions.held(time[:, None])
        return Boxes(moved(self.low, least, factors), moved(self.high, most, factors))

    def within(self, time: Array, motions: Motions) -> "Boxes":
        """Return boxes that contain all states from now to a time later, shape (n,)."""
        low, high = self.after(time, motions, -motions.authority, motions.authority)
        axes, time = low.shape[1] // 2, time[:, None]
        # A speed's end rises or falls all the time: it is extreme at the begin or at the end.
        slow = np.minimum(self.low[:, axes:], low[:, axes:])
        fast = np.maximum(self.high[:, axes:], high[:, axes:])
        near = np.minimum(low[:, :axes], self.low[:, :axes] + np.minimum(0.0, slow) * time)
        far = np.maximum(high[:, :axes], self.high[:, :axes] + np.maximum(0.0, fast) * time)
        return Boxes(np.concatenate([near, slow], axis=1), np.concatenate([far, fast], axis=1))

    def distance(self, p: Array) -> Array:
        """Distance of a place from each box, shape (n,) [m]."""
        axes = p.shape[-1]
        outside = np.maximum(self.low[:, :axes] - p, p - self.high[:, :axes])
        return length(np.maximum(0.0, outside))

    def speed(self) -> Array:
        """The largest ‖v‖ in each box, shape (n,) [m/s]."""
        return length(self.fastest())

    def fastest(self) -> Array:
        """The largest |v| on each axis, shape (n, axes) [m/s]."""
        axes = self.low.shape[1] // 2
        fast: Array = np.maximum(-self.low[:, axes:], self.high[:, axes:])
        return fast


def enclosures(
    states: Sequence[HeardState],
    times: Array,
    motions: Motions,
    stamp_error: float = 0.0,
    believes: bool = False,
) -> Boxes:
    """Enclose the references of peers at some times.

    Args:
        states: as each was heard.
        times: for each peer, shape (n,) [s].
        motions: of the peers.
        stamp_error: bound on the error of a stamp [s].
        believes: whether an announced input was applied, for as long as an input is at least held.
    """
    z = np.array([state.z for state in states])
    stamps, boxes, bound = np.array([state.t for state in states]), Boxes(z, z), motions.authority
    sure = np.maximum(0.0, times - stamps - stamp_error)
    rest = sure
    if believes:
        u = np.array([state.u for state in states])
        begin = np.array([state.t_apply for state in states]) - stamps
        begin, end = (_clipped(a, 0.0, sure) for a in (begin, begin + motions.shortest))
        least, most = (_clipped(u + r, -bound, bound) for r in (-motions.reserve, motions.reserve))
        boxes = boxes.after(begin, motions, -bound, bound).after(end - begin, motions, least, most)
        rest = sure - end
    boxes = boxes.after(rest, motions, -bound, bound)
    if stamp_error > 0.0:
        boxes = boxes.within(np.maximum(0.0, times - stamps) + stamp_error - sure, motions)
    return boxes


def _clipped(a: Array, low: Array | float, high: Array) -> Array:
    within: Array = np.minimum(np.maximum(a, low), high)
    return within
