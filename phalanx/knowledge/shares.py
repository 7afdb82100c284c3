"""Gaps to peers that keep their half: larger than those by sets, for as long as they do.

A peer's state was sampled at t_s, when the gap was g_s. Since then the agent itself has spent at
most C of it, and has at no time given back more than C⁻. On each hold, of at most τ_j, the peer
spends at most ½ κ times what the gap was when it began; so of g_s + C⁻ at least a share E is left::

    E = (1 - ½ κ τ_j)^n (1 - ½ κ r),  t - t_s = n τ_j + r      gap >= (g_s + C⁻) E - C⁻ - C

C is the change of the own L since t_s, which is known, and the way closed in on the peer: at most
the sum of its largest rates, each over the cone of one piece of a hold. (The chord of the own path
would not be sound.) Without memory of t_s there is no share. A peer that lies voids it.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import islice
from math import inf
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.cones import cones, own_motion
from phalanx.knowledge.held import moved
from phalanx.knowledge.motion import Motion, Motions
from phalanx.knowledge.sets import Boxes, HeardState
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length

_MOST_HOLDS = 1000
_LEAST_REST = 1e-3
"""E below which a share is not worth its sums."""
_PARTS = np.array([0.0, 0.5, 1.0])
"""Ends of a past hold's pieces."""

Enclose = Callable[[Sequence[HeardState], Array, Motions], Boxes]
"""Sets of peers with these states, each at a time of its own."""


class Hold(NamedTuple):
    """One input that the agent's own reference held, or a part of that."""

    t: float
    z: Array
    """Its reference at the begin, shape (2 axes,)."""
    u: Array
    end: float


def after(hold: Hold, t: float, motion: Motion) -> Array:
    """The reference at a time within a hold or at its end, shape (2 axes,)."""
    return moved(hold.z, hold.u, motion.held(np.array([t - hold.t])))


class _Past(NamedTuple):
    """The own past since a peer's sample."""

    z: Array
    """The own reference then, shape (2 axes,)."""
    holds: list[Hold]


class _Closing(NamedTuple):
    """Ways closed in on a peer during one hold [m], and the own speed's extremes [m/s]."""

    most: float
    least: float
    opened: float
    """The way by which the agent may have gone back within the hold, at most."""
    slowest: float
    fastest: float


class Shares:
    """One agent's memory of its own reference, and the shares of gaps that follow from it."""

    def __init__(
        self,
        motion: Motion,
        radius: float,
        share: float,
        stamp_error: float,
        enclose: Enclose,
    ) -> None:
        """Begin without memory.

        Args:
            motion: the agent's own.
            radius: R [m].
            share: ½ κ [1/s].
            stamp_error: bound on the error of a time stamp [s].
            enclose: makes the peers' sets.
        """
        self._motion, self._radius, self._share = motion, radius, share
        self._stamp_error, self._enclose = stamp_error, enclose
        self._holds: deque[Hold] = deque(maxlen=_MOST_HOLDS)

    def remember(self, hold: Hold) -> None:
        """Add a hold that has ended."""
        self._holds.append(hold)

    def forget(self) -> None:
        """Drop all memory: the reference did not go on from where it was."""
        self._holds.clear()

    def gaps(self, t: float, z: Array, states: Sequence[HeardState], motions: Motions) -> Array:
        """Gaps to n peers at time t, -∞ without a share; shape (n,) [m].

        Args:
            t: of the sample [s], at which the last hold has ended.
            z: the reference, shape (2 axes,).
            states: the newest state heard of each peer.
            motions: of the peers.
        """
        axes = self._motion.axes
        ages = [max(0.0, t - state.t) + self._stamp_error for state in states]
        rests = list(map(partial(_rest, self._share), motions.longest.tolist(), ages))
        pasts = [
            self._past(state, t, z) if rest > _LEAST_REST else None
            for state, rest in zip(states, rests, strict=True)
        ]
        closings = self._closings(pasts, states, motions)
        others = motions.tube + motions.stopping(length(np.array([s.z for s in states])[:, axes:]))
        gaps = np.full(len(states), -np.inf)
        for n, (state, past) in enumerate(zip(states, pasts, strict=True)):
            if past is None:
                continue
            gap_then = (
                length((past.z - state.z)[:axes]) - self._radius - self._motion.tube - others[n]
            )
            since = islice(closings, len(past.holds))
            gaps[n] = self._left(float(gap_then), rests[n], _speed(past.z), _speed(z), since)
        return gaps

    def _left(
        self, gap_then: float, rest: float, before: float, now: float, closings: Iterator[_Closing]
    ) -> float:
        """The gap that is left.

        Args:
            gap_then: distance at t_s, less R, tubes and the other's L [m].
            rest: E.
            before: the own speed at t_s [m/s].
            now: the own speed.
            closings: of the holds since t_s.
        """
        stopping, fastest = self._motion.stopping, before
        gap, spent, least, regained = gap_then - stopping(before), 0.0, 0.0, 0.0
        for closing in closings:
            back = stopping(before) - stopping(closing.slowest) - least + closing.opened
            regained, fastest = max(regained, back), max(fastest, closing.fastest)
            spent, least = spent + closing.most, least + closing.least
        if gap < 0.0:
            return -inf
        spent += stopping(now) - stopping(before)
        # The own state at another time than the stamp's counts in g_s, C and C⁻.
        error = self._stamp_error
        unsure = 2.0 * error * self._motion.rate(fastest, error) if error > 0.0 else 0.0
        return (gap + regained) * rest - regained - spent - unsure

    def _past(self, state: HeardState, t: float, z: Array) -> _Past | None:
        """The own past since a peer's sample, the first hold cut; None where it has no share."""
        axes, holds = self._motion.axes, list[Hold]()
        started_moving = state.t <= 0.0 and bool((state.z[axes:] != 0.0).any())
        if started_moving or state.t_apply > state.t:  # what it does was not chosen at the state
            return None
        if state.t >= t:
            return _Past(z, holds)
        for hold in reversed(self._holds):
            holds.append(hold)
            if hold.t <= state.t:
                begin = after(hold, state.t, self._motion)
                holds[-1] = Hold(state.t, begin, hold.u, hold.end)
                return _Past(begin, holds[::-1])
        return None

    def _closings(
        self, pasts: Sequence[_Past | None], states: Sequence[HeardState], motions: Motions
    ) -> Iterator[_Closing]:
        """Bounds on the way closed in during each hold on its peer, peer by peer."""
        parts = [(n, hold) for n, past in enumerate(pasts) if past for hold in past.holds]
        if not parts:
            return iter(())
        motion, axes = self._motion, self._motion.axes
        peers, holds = zip(*parts, strict=True)
        motions, begin = motions.of(peers), np.array([hold.t for hold in holds])
        z, u = np.array([hold.z for hold in holds]), np.array([hold.u for hold in holds])
        times = (np.array([hold.end for hold in holds]) - begin)[:, None] * _PARTS
        then = own_motion(z, motion)
        boxes = self._enclose([states[n] for n in peers], begin, motions)
        around = cones(then, boxes, motions, times)
        v = motion.on_the_way(z[:, axes:], u, motion.held(times))
        spans = times[:, 1:] - times[:, :-1]
        most, back = (
            spans * np.maximum(around.closing(path[:, :-1]), around.closing(path[:, 1:]))
            for path in (v, -v)
        )
        columns = most, -back, np.maximum(back, 0.0)
        sums = [np.add.reduce(column, axis=1).tolist() for column in columns]
        speeds = _slowest(v[:, 0], v[:, -1]).tolist(), length(v).max(axis=1).tolist()
        return map(_Closing, *sums, *speeds)


def _rest(share: float, longest: float, age: float) -> float:
    """E, by products: powers of libm have other bits on other machines."""
    count, rest, factor = int(age / longest), 1.0, 1.0 - share * longest
    part = 1.0 - share * max(0.0, age - count * longest)
    while count:
        if count % 2:
            rest *= factor
        factor, count = factor * factor, count // 2
    return rest * part


def _speed(z: Array) -> float:
    return float(length(z[len(z) // 2 :]))


def _slowest(before: Array, after: Array) -> Array:
    """The least speed on the way from one velocity to another, which is straight; shape (n,)."""
    change = after - before
    square = dot(change, change)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(square > 0.0, -dot(before, change) / square, 0.0)
    return length(before + np.minimum(np.maximum(share, 0.0), 1.0)[:, None] * change)
