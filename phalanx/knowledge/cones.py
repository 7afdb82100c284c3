"""Cones of directions: where an agent can be, as seen from a peer, in each piece of a hold.

n is the unit vector from the peer to the agent. Their relative place stays in a box while a piece
lasts, and all directions to a box are within the largest angle to one of its corners, if that is
below 90°.
"""

from itertools import product
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import halves
from phalanx.knowledge.motion import Motion, Motions
from phalanx.knowledge.sets import Boxes
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length

_ROUNDING = 1e-12
"""Taken from cosines."""


class Cones(NamedTuple):
    """A cone for each peer and piece: the n within an angle δ of an axis; all n where cos δ = -1.

    >>> ahead = Cones(np.array([[[1.0, 0.0]]]), np.array([[0.8]]), np.array([[0.6]]))
    >>> ahead.closing(np.array([0.0, -2.0]))
    array([[1.2]])
    """

    axis: Array
    """shape (n, m, axes)"""
    cos: Array
    """shape (n, m)"""
    sin: Array

    def closing(self, v: Array) -> Array:
        """The largest -n·v of each cone, at which v may close in; convex in v.

        Args:
            v: of a shape that goes with the axes'.
        """
        along = -dot(self.axis, v)
        size, lateral = length(v), length(v + along[..., None] * self.axis)
        inside = along >= self.cos * size
        worst: Array = np.where(inside, size, along * self.cos + lateral * self.sin)
        return worst


class Own(NamedTuple):
    """The agent's own motion from the begin of a hold, or of n holds."""

    p: Array
    """shape (axes,) or (n, axes) [m]"""
    v: Array
    drag: float
    authority: float
    jumps: bool


def own_motion(z: Array, motion: Motion) -> Own:
    """The agent's own motion from its state (p, v) on, or from n of them."""
    p, v = halves(z)
    return Own(p, v, motion.drag, motion.authority, motion.jumps)


def cones(own: Own, peers: Boxes, motions: Motions, times: Array) -> Cones:
    """Enclose the directions from each peer in each piece of a hold.

    Args:
        own: at the begin of the hold.
        peers: at the same time.
        motions: of the peers.
        times: ends of the pieces, from 0 on, shape (m + 1,) or (n, m + 1) [s].
    """
    axes, fastest = own.p.shape[-1], peers.fastest()
    middle, half = 0.5 * (peers.low + peers.high), 0.5 * (peers.high - peers.low)
    begin, end = times[..., :-1, None], times[..., 1:, None]
    relative = (own.v - middle[:, axes:])[:, None]
    # Of the inputs, and of the drag, which shortens a way v t by at most ½ β v t².
    change = own.authority + motions.authority + own.drag * np.abs(own.v) + motions.drag * fastest
    centre = (own.p - middle[:, :axes])[:, None] + relative * (0.5 * (begin + end))
    spread = half[:, None, :axes] + half[:, None, axes:] * end
    spread = spread + np.abs(relative) * (0.5 * (end - begin))
    spread = spread + change[:, None] * (end if own.jumps else 0.5 * end * end)
    return _around(centre, spread)


def _around(centre: Array, spread: Array) -> Cones:
    """The cones of boxes with these centres and half widths, shapes (n, m, axes)."""
    signs = np.array(list(product((-1.0, 1.0), repeat=centre.shape[-1])))
    corners = centre[..., None, :] + signs * spread[..., None, :]
    with np.errstate(divide="ignore", invalid="ignore"):
        axis = centre / length(centre)[..., None]
        cosines = dot(corners, axis[..., None, :]) / length(corners)
    cos = np.minimum.reduce(cosines, axis=-1) - _ROUNDING
    narrow = cos > 0.0  # not where the agent may be in the box
    cos = np.where(narrow, cos, -1.0)
    axis = np.where(narrow[..., None], axis, 0.0)
    return Cones(axis, cos, np.sqrt(1.0 - cos * cos))


def everywhere(count: int, pieces: int, axes: int) -> Cones:
    """Cones of all directions, of peers of which nothing is known."""
    shape = count, pieces
    return Cones(np.zeros((*shape, axes)), np.full(shape, -1.0), np.zeros(shape))


def fixed(directions: Array, pieces: int) -> Cones:
    """Cones of one direction each, shape (n, axes), in all pieces."""
    axis = np.repeat(directions[:, None], pieces, axis=1)
    shape = axis.shape[:2]
    return Cones(axis, np.ones(shape), np.zeros(shape))


def joined(cones: list[Cones]) -> Cones:
    """Cones of several kinds of peers, one after another."""
    if len(cones) == 1:
        return cones[0]
    return Cones(*(np.concatenate(column) for column in zip(*cones, strict=True)))
