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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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


class _Closing(NamedTuple):
    """Ways closed in on a peer during one hold [m], and the own speed's extremes [m/s]."""

    most: float
    least: float
    opened: float
    """The way by which the agent may have gone back within the hold, at most."""
    slowest: float
    fastest: float


@dataclass(slots=True)
class _Past:
    """The own past since a peer's sample, as far as it is counted."""

    gap: float
    """Between both then, less R, tubes and ways to stop [m]."""
    z: Array
    """The own reference then, shape (2 axes,)."""
    first: int
    """Number of the hold in which that was."""
    counted: int
    """Number of the first hold that is not counted yet."""
    stopping: float
    """The own L then [m]."""
    fastest: float
    """The largest own speed since [m/s]."""
    spent: float = 0.0
    """The way closed in since, at most [m]."""
    least: float = 0.0
    """The same, at least [m]."""
    regained: float = 0.0
    """C⁻ [m]."""

    def count(self, closing: _Closing, stopping: float) -> None:
        """Count the next hold; stopping: L at its slowest [m]."""
        back = self.stopping - stopping - self.least + closing.opened
        self.regained = max(self.regained, back)
        self.fastest = max(self.fastest, closing.fastest)
        self.spent, self.least = self.spent + closing.most, self.least + closing.least


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
        self._end = 0
        """Number of the next hold."""
        self._pasts: list[tuple[HeardState, _Past]] = []
        """Since the states that counted last: with each hold only that one is added."""

    def remember(self, hold: Hold) -> None:
        """Add a hold that has ended."""
        self._holds.append(hold)
        self._end += 1

    def forget(self) -> None:
        """Drop all memory: the reference did not go on from where it was."""
        self._holds.clear()
        self._pasts = []

    def gaps(self, t: float, z: Array, states: Sequence[HeardState], motions: Motions) -> Array:
        """Gaps to n peers at time t, -∞ without a share; shape (n,) [m].

        Args:
            t: of the sample [s], at which the last hold has ended.
            z: the reference, shape (2 axes,).
            states: the newest state heard of each peer.
            motions: of the peers.
        """
        ages = [max(0.0, t - state.t) + self._stamp_error for state in states]
        rests = list(map(partial(_rest, self._share), motions.longest.tolist(), ages))
        pasts = {
            n: past
            for n, state in enumerate(states)
            if rests[n] > _LEAST_REST
            and (past := self._past(state, t, z, partial(motions.of, [n])))
        }
        self._pasts = [(states[n], past) for n, past in pasts.items() if states[n].t < t]
        self._count(pasts, states, motions)
        gaps, now = np.full(len(states), -np.inf), _speed(z)
        for n, past in pasts.items():
            gaps[n] = self._left(past, rests[n], now)
        return gaps

    def _left(self, past: _Past, rest: float, now: float) -> float:
        """The gap that is left of one with a past; rest: E; now: the own speed [m/s]."""
        if past.gap < 0.0:
            return -inf
        spent = past.spent + (self._motion.stopping(now) - past.stopping)
        # The own state at another time than the stamp's counts in g_s, C and C⁻.
        error = self._stamp_error
        unsure = 2.0 * error * self._motion.rate(past.fastest, error) if error > 0.0 else 0.0
        return (past.gap + past.regained) * rest - past.regained - spent - unsure

    def _past(
        self, state: HeardState, t: float, z: Array, peer: Callable[[], Motions]
    ) -> _Past | None:
        """The own past since the sample of a peer; None where it has no share."""
        axes, oldest = self._motion.axes, self._end - len(self._holds)
        started_moving = state.t <= 0.0 and bool((state.z[axes:] != 0.0).any())
        if started_moving or state.t_apply > state.t:  # what it does was not chosen at the state
            return None
        if state.t >= t:
            return self._begun(state, z, self._end, peer())
        for known, past in self._pasts:
            if known is state:
                return past if past.first >= oldest else None
        for back, hold in enumerate(reversed(self._holds), start=1):
            if hold.t <= state.t:
                begin = after(hold, state.t, self._motion)
                return self._begun(state, begin, self._end - back, peer())
        return None

    def _begun(self, state: HeardState, z: Array, first: int, peer: Motions) -> _Past:
        """The past since a peer's sample, when the own reference was z, with no hold counted."""
        axes, stopping = self._motion.axes, self._motion.stopping(_speed(z))
        other = peer.tube + peer.stopping(length(state.z[None, axes:]))
        gap = length((z - state.z)[:axes]) - self._radius - self._motion.tube - other[0]
        return _Past(float(gap) - stopping, z, first, first, stopping, fastest=_speed(z))

    def _count(
        self, pasts: Mapping[int, _Past], states: Sequence[HeardState], motions: Motions
    ) -> None:
        """Count in each peer's past the holds that have ended since; the first one is cut."""
        oldest, parts = self._end - len(self._holds), list[tuple[int, Hold]]()
        for n, past in pasts.items():
            for number in range(past.counted, self._end):
                hold = self._holds[number - oldest]
                if number == past.first:
                    hold = Hold(states[n].t, past.z, hold.u, hold.end)
                parts.append((n, hold))
            past.counted = self._end
        for (n, _), closing in zip(parts, self._closings(parts, states, motions), strict=True):
            pasts[n].count(closing, self._motion.stopping(closing.slowest))

    def _closings(
        self, parts: Sequence[tuple[int, Hold]], states: Sequence[HeardState], motions: Motions
    ) -> Iterator[_Closing]:
        """Bounds on the way closed in on some peers, each during a hold."""
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
        ends = np.stack([v[:, :-1], v[:, 1:]])
        first, last = around.closing(np.stack([ends, -ends], axis=1))
        most, back = spans * np.maximum(first, last)
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
