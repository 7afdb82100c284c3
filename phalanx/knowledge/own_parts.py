"""The inputs of one agent among peers that it knows by radio: its own parts, kept or braked.

Theorem B: with V = R + 2ρ + L_i + L_j - d <= 0 at the start, each agent whose own part stays
<= ½ κ max(0, -V) through every hold, by whatever it knows, keeps V <= 0 for ever, at any age:
V' <= ½ κ Σ max(0, -V(t - s)), s <= τ, and κ τ <= 1/e. A gap by a set is never above -V, and the
brake spends nothing, whatever is known; so there always is an input.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.choice import InputChoice, Limits
from phalanx.knowledge.cones import Cones, cones, everywhere, fixed, joined, own_motion
from phalanx.knowledge.motion import Motion, Motions, stacked
from phalanx.knowledge.sets import Boxes, HeardState, PeerSet, enclosures
from phalanx.knowledge.shares import Hold, Shares, after
from phalanx.knowledge.spending import hold_pieces
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.exact import dot, length
from phalanx.theory.rows.row import Rows

_E = 2.718281828459046
"""e, rounded upwards."""
_PIECES = 4
_CLOSE = 1e-6
"""Allowed for rounding and integration of a state, relative to its size."""
_ROUNDING = 1e-9
"""Taken from every gap [m]."""


class OwnPartsInput(NamedTuple):
    """An agent's input, and what it was made from."""

    u: Array
    """The applied input, shape (axes,)."""
    braked: bool
    stands: bool
    """Whether a peer has never been heard."""
    gaps: Mapping[int, float]
    """-V at least, of each peer that was heard [m]."""
    sets: Mapping[int, PeerSet]
    """Its reference."""
    binding: tuple[int, ...]
    """Whose gaps keep the input from the wish: peers, -1 - k for obstacle k."""


class OwnParts:
    """One normal agent's own parts towards peers known by radio and towards static obstacles."""

    reference: Array
    """z at the last sample, to be broadcast."""
    limits: Limits | None
    """Of own parts at the last sample; None if none could be too large."""
    near: Sequence[int]
    """The peers of these limits; -1 - k for obstacle k."""
    inputs: Array
    """Of the reference at the last sample: the wish and the chosen one, shape (2, axes)."""
    _last: Hold | None

    def __init__(
        self,
        motion: Motion,
        peers: Mapping[int, Motion],
        radius: float,
        kappa: float,
        *,
        believes: bool = False,
        stamp_error: float = 0.0,
        start: Array | None = None,
    ) -> None:
        """Prepare an agent's choice.

        Args:
            motion: the agent's own.
            peers: of each peer.
            radius: R, the required distance of the output points [m].
            kappa: κ, the same for all agents [1/s]; at most 1/(e τ) is used, τ the longest of all.
            believes: whether an announced input is taken to be applied.
            stamp_error: bound on the error of a time stamp [s].
            start: the reference at time 0, if peers know it; with no input it goes on from there.
        """
        self._motion, self._names = motion, sorted(peers)
        self._motions = stacked([peers[l] for l in self._names])
        longest = max([motion.longest, *(m.longest for m in peers.values())])
        self.share, self.radius = 0.5 * min(kappa, 1.0 / (_E * longest)), radius
        self._enclose = partial(enclosures, stamp_error=stamp_error, believes=believes)
        accounts = motion, radius, self.share, stamp_error, self._enclose
        self._shares, self._last = Shares(*accounts), None
        if start is not None:
            self._last = Hold(0.0, start, np.zeros(motion.axes), 0.0)
        self._pieces = hold_pieces(motion, _PIECES)
        self._choice = InputChoice(motion, self._pieces)

    def __call__(
        self,
        t: float,
        x: Array,
        heard: Mapping[int, HeardState],
        wish: Array,
        whole: Rows | None = None,
        static: Sequence[tuple[float, Array]] = (),
        turn: Array | None = None,
    ) -> OwnPartsInput:
        """Choose the input of a sample.

        Args:
            t: its time [s].
            x: the sampled state (p, v), shape (2 axes,).
            heard: the newest state heard of each peer; known starts count as heard at 0.
            wish: the nominal input, shape (axes,).
            whole: rows a u <= bound on the applied input, which yield.
            static: distance of x to each convex obstacle, and the unit vector away from it.
            turn: rotation of the set of inputs, shape (axes, axes); None for none.
        """
        z = self.reference = self._reference(t, x)
        pull = self._motion.tracking.pull(x - z)
        names = [l for l in self._names if l in heard]
        states = [heard[l] for l in names]
        motions = self._motions.of([n for n, l in enumerate(self._names) if l in heard])
        boxes = self._sets(t, states, motions)
        gaps, near = self._gaps(t, boxes, states, motions)
        # An obstacle is beyond a plane, and z may be nearer to that than x.
        behind = (z - x)[: self._motion.axes]
        static = [(distance + float(dot(n, behind)), n) for distance, n in static]
        limits = self._limits(boxes.of(near), motions.of(near), gaps[near], static, len(names))
        unheard = [l for l in self._names if l not in heard]
        near_peers = [names[n] for n in near.tolist()]
        obstacles = range(-1, -1 - len(static), -1)
        self.limits, self.near = limits, [*near_peers, *obstacles, *unheard]
        shifted = None if whole is None else Rows(whole.a, whole.bound - dot(whole.a, pull))
        chosen = self._choice.nearest(wish - pull, z[self._motion.axes :], limits, shifted, turn)
        self._last = Hold(t, z, chosen.u, t)
        self.inputs = np.array([wish - pull, chosen.u])
        rows = zip(boxes.low, boxes.high, states, strict=True)
        sets = [PeerSet(low, high, t - state.t) for low, high, state in rows]
        return OwnPartsInput(
            u=chosen.u + pull,
            braked=chosen.braked,
            stands=len(names) < len(self._names),
            gaps=dict(zip(names, gaps.tolist(), strict=True)),
            sets=dict(zip(names, sets, strict=True)),
            binding=tuple([self.near[k] for k in chosen.binding]),
        )

    def spending(self) -> Array:
        """Return the own parts of `inputs` in the order of `near`, shape (2, n) [m/s]."""
        if self.limits is None:
            return np.empty((2, 0))
        v = self.reference[self._motion.axes :]
        return self._pieces.spending(v, self.inputs, self.limits.cones)

    def _reference(self, t: float, x: Array) -> Array:
        """z at a sample: on from where it was; from x if that is out of the tube, or if it is 0."""
        if self._last is None:
            return x
        tracking, z = self._motion.tracking, after(self._last, t, self._motion)
        if tracking.size(x - z) > tracking.radius + _CLOSE * (1.0 + float(length(z))):
            self._shares.forget()
            return x
        self._shares.remember(self._last._replace(end=t))
        return z if tracking.tube > 0.0 else x

    def _sets(self, t: float, states: Sequence[HeardState], motions: Motions) -> Boxes:
        if states:
            return self._enclose(states, np.full(len(states), t), motions)
        nothing = np.empty((0, 2 * self._motion.axes))
        return Boxes(nothing, nothing)

    def _gaps(
        self, t: float, boxes: Boxes, states: Sequence[HeardState], motions: Motions
    ) -> tuple[Array, Index]:
        """-V of each peer at most, shape (n,) [m], and who is so near that it may bind.

        Shares are counted only where the set leaves so little that an own part may be too large.
        """
        p, speed = self.reference[: self._motion.axes], self._speed()
        way = self.radius + self._motion.tube + self._motion.stopping(speed) + _ROUNDING
        gaps = boxes.distance(p) - way - motions.tube - motions.stopping(boxes.speed())
        most = self._motion.rate(speed, self._motion.longest) / self.share
        near = np.flatnonzero(~(gaps >= most))  # so is a gap that is not a number
        if near.size:
            some = [states[n] for n in near.tolist()]
            shares = self._shares.gaps(t, self.reference, some, motions.of(near)) - _ROUNDING
            gaps[near] = np.maximum(gaps[near], shares)
        return gaps, near[~(gaps[near] >= most)]

    def _limits(
        self,
        boxes: Boxes,
        motions: Motions,
        gaps: Array,
        static: Sequence[tuple[float, Array]],
        heard: int,
    ) -> Limits | None:
        """Cones and own parts of near peers, then of obstacles, then of peers never heard."""
        motion, axes, around, most = self._motion, self._motion.axes, list[Cones](), list[Array]()
        if len(gaps):
            begin = own_motion(self.reference, motion)
            around.append(cones(begin, boxes, motions, self._pieces.times))
            most.append(self.share * gaps)
        if static:
            around.append(fixed(np.array([n for _, n in static]), _PIECES))
            clear = np.array([distance for distance, _ in static]) - motion.tube - _ROUNDING
            most.append(2.0 * self.share * (clear - motion.stopping(self._speed())))
        if unheard := len(self._names) - heard:
            around.append(everywhere(unheard, _PIECES, axes))
            most.append(np.zeros(unheard))
        return Limits(joined(around), np.maximum(0.0, np.concatenate(most))) if around else None

    def _speed(self) -> float:
        return float(length(self.reference[self._motion.axes :]))
