"""An agent's own part: how fast an input may spend the gap to a peer, at most, over a hold.

With z = (p, v) the reference and n the direction from the peer, the own part is::

    (d/dt) L(‖v‖) - n·v,   L = ‖v‖²/2A + τ ‖v‖

In k = (1 - e^{-βt}) / β the speed is linear, v(k) = v + c k, c = u - β v, and d/dt = (1 - βk) d/dk.
On a piece of the hold v·c/A + τ d‖v‖/dk never falls, 1 - βk never rises, and the largest -n·v over
a cone is convex: each is bounded by its ends.
"""

import numpy as np

from phalanx.knowledge.cones import Cones
from phalanx.knowledge.motion import Motion, PointMotion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length


class HoldPieces:
    """The pieces of an agent's longest hold, of equal length."""

    def __init__(self, motion: PointMotion, pieces: int) -> None:
        self._motion = motion
        self.times = _ends(motion, pieces)
        """Their ends, shape (m + 1,) [s]."""
        self._k = motion.held(self.times).speed
        self._rate = 1.0 - motion.drag * self._k

    def spending(self, v: Array, u: Array, cones: Cones) -> Array:
        """The largest own part of each input towards each peer over the hold [m/s].

        Args:
            v: the reference's speed at the begin, shape (axes,).
            u: inputs, shape (q, axes).
            cones: of n peers.

        Returns:
            shape (q, n).
        """
        motion, k, rate = self._motion, self._k, self._rate
        c = u - motion.drag * v
        path = v + c[:, None] * k[:, None]
        c_size, speed = length(c)[:, None], length(path)
        # v·v(k)' and d‖v‖/dk at the pieces' ends; at rest the speed rises with ‖c‖.
        inner = dot(c, v)[:, None] + c_size * c_size * k
        with np.errstate(divide="ignore", invalid="ignore"):
            faster = np.where(speed > 0.0, inner / speed, c_size)
        # Near rest the quotient is rounding alone; no speed changes faster than by ‖c‖.
        faster = np.minimum(np.maximum(faster, -c_size), c_size)
        growth = (inner / motion.authority + motion.longest * faster)[:, 1:]
        growth = growth * np.where(growth > 0.0, rate[:-1], rate[1:])
        ends = np.stack([path[:, :-1], path[:, 1:]])[:, :, None]
        closing = np.maximum.reduce(cones.closing(ends), axis=0)
        most: Array = np.maximum.reduce(growth[:, None] + closing, axis=-1)
        return most


class HeldVelocities:
    """The pieces of the longest hold of an input that is a velocity u: its own part is -n·u."""

    def __init__(self, motion: VelocityMotion, pieces: int) -> None:
        self.times = _ends(motion, pieces)
        """Their ends, shape (m + 1,) [s]."""

    def spending(self, v: Array, u: Array, cones: Cones) -> Array:
        """The largest own part of each input, as HoldPieces has it."""
        most: Array = np.maximum.reduce(cones.closing(u[:, None, None]), axis=-1)
        return most


Pieces = HoldPieces | HeldVelocities


def hold_pieces(motion: Motion, pieces: int) -> Pieces:
    """Return the pieces of an agent's longest hold."""
    if isinstance(motion, PointMotion):
        return HoldPieces(motion, pieces)
    return HeldVelocities(motion, pieces)


def _ends(motion: Motion, pieces: int) -> Array:
    return np.array([motion.longest * n / pieces for n in range(pieces + 1)])
