"""An agent's own part: how fast an input may spend the gap to a peer, at most, over a hold.

With z = (p, v) the reference and n the direction from the peer, the own part is::

    (d/dt) L(‖v‖) - n·v,   L = ‖v‖²/2A + τ ‖v‖

In k = (1 - e^{-βt}) / β the speed is linear, v(k) = v + c k, c = u - β v, and d/dt = (1 - βk) d/dk.
On a piece of the hold v·c/A + τ d‖v‖/dk never falls, 1 - βk never rises, and the largest -n·v over
a cone is convex: each is bounded by its ends. spending.c computes the same bits, and runs where
`phalanx compile` has built it.
"""

import ctypes
from pathlib import Path

import numpy as np

from phalanx.knowledge.cones import Cones
from phalanx.knowledge.motion import Motion, PointMotion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.native.library import address, native_source, sample_states
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length


class HoldPieces:
    """The pieces of an agent's longest hold, of equal length."""

    def __init__(self, motion: PointMotion, pieces: int) -> None:
        self.times = _ends(motion, pieces)
        """Their ends, shape (m + 1,) [s]."""
        k = motion.held(self.times).speed
        bounds = [motion.drag, motion.authority, motion.longest]
        self._hold = np.concatenate([bounds, k, 1.0 - motion.drag * k])
        source = Path(__file__).with_suffix(".c").read_text("utf-8")
        compiled = native_source(source, _Compiled) if motion.axes <= _MOST_AXES else None
        self._own_parts = compiled or own_parts

    def spending(self, v: Array, u: Array, cones: Cones) -> Array:
        """The largest own part of each input towards each peer over the hold [m/s].

        Args:
            v: the reference's speed at the begin, shape (axes,).
            u: inputs, shape (q, axes).
            cones: of n peers.

        Returns:
            shape (q, n).
        """
        return self._own_parts(self._hold, v, u, cones)


def own_parts(hold: Array, v: Array, u: Array, cones: Cones) -> Array:
    """The largest own parts, as HoldPieces.spending returns them.

    hold: β, A and τ, then k and 1 - βk at the pieces' ends, shape (3 + 2 (m + 1),).
    """
    (drag, authority, longest), (k, rate) = hold[:3].tolist(), hold[3:].reshape(2, -1)
    c = u - drag * v
    path = v + c[:, None] * k[:, None]
    c_size, speed = length(c)[:, None], length(path)
    # v·v(k)' and d‖v‖/dk at the pieces' ends; at rest the speed rises with ‖c‖.
    inner = dot(c, v)[:, None] + c_size * c_size * k
    with np.errstate(divide="ignore", invalid="ignore"):
        faster = np.where(speed > 0.0, inner / speed, c_size)
    # Near rest the quotient is rounding alone; no speed changes faster than by ‖c‖.
    faster = np.minimum(np.maximum(faster, -c_size), c_size)
    growth = (inner / authority + longest * faster)[:, 1:]
    growth = growth * np.where(growth > 0.0, rate[:-1], rate[1:])
    ends = np.stack([path[:, :-1], path[:, 1:]])[:, :, None]
    closing = np.maximum.reduce(cones.closing(ends), axis=0)
    most: Array = np.maximum.reduce(growth[:, None] + closing, axis=-1)
    return most


_MOST_AXES = 3
"""D in spending.c; with more, the reference runs."""


class _Compiled:
    """own_parts in C."""

    def __init__(self, library: ctypes.PyDLL) -> None:
        """Raise ValueError unless the bits are the reference's."""
        self._function = library.spending
        self._function.argtypes = (*[ctypes.c_int] * 4, *[ctypes.c_void_p] * 3)
        self._function.restype = None
        for axes in range(1, _MOST_AXES + 1):
            sizes = 11, axes, 2 * axes, 12 * axes, 12
            for sample in sample_states(sum(sizes))[::5]:
                hold, v, u, axis, cos = np.split(sample, np.cumsum(sizes[:-1]))
                axis, cos = axis.reshape(4, 3, axes), cos.reshape(4, 3) % 1.0
                axis = axis / length(axis)[..., None]
                program = hold, v, u.reshape(2, axes), Cones(axis, cos, np.sqrt(1.0 - cos * cos))
                if (self(*program) != own_parts(*program)).any():
                    raise ValueError("spending.c computes other bits")

    def __call__(self, hold: Array, v: Array, u: Array, cones: Cones) -> Array:
        n, m, axes = cones.axis.shape
        numbers = np.concatenate([v, *map(np.ravel, (u, *cones))])
        most = np.empty((len(u), n))
        self._function(len(u), n, m, axes, address(hold), address(numbers), address(most))
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
