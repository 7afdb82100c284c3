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
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.cones import Own, cones
from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import Motions, PointMotion
from phalanx.knowledge.sets import Boxes, HeardState
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot, length

_MOST_HOLDS = 1000
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


def after(hold: Hold, t: float, drag: float) -> Array:
    """The reference at a time within a hold or at its end, shape (2 axes,)."""
    return moved(hold.z, hold.u, held(np.array([drag]), np.array([t - hold.t])))


class Account(NamedTuple):
    """All that bounds the gap to a peer since it was heard."""

    state: HeardState
    apart: float
    """Distance at its sample, less R, tubes and the other's L [m]."""
    way: float
    """The own L at that time [m]."""
    closed: float = 0.0
    """The way closed in on it since, at most [m]."""
    least: float = 0.0
    """The way closed in on it, at least [m]."""
    regained: float = 0.0
    """C⁻ [m]"""
    fastest: float = 0.0
    """The own largest speed since [m/s]."""


class _Closing(NamedTuple):
    """Ways closed in on a peer during one hold, and the own motion's extremes [m, m/s]."""

    most: float
    least: float
    opened: float
    """The way by which the agent may have gone back within the hold, at most."""
    slowest: float
    fastest: float


class Shares:
    """One agent's accounts of the gaps to its peers."""

    def __init__(
        self,
        motion: PointMotion,
        motions: Motions,
        radius: float,
        share: float,
        stamp_error: float,
        enclose: Enclose,
    ) -> None:
        """Begin without memory.

        Args:
            motion: the agent's own.
            motions: of all peers; an account has a peer's index among them.
            radius: R [m].
            share: ½ κ [1/s].
            stamp_error: bound on the error of a time stamp [s].
            enclose: makes the peers' sets.
        """
        self._motion, self._motions = motion, motions
        self._radius, self._share, self._stamp_error = radius, share, stamp_error
        self._enclose = enclose
        self._holds: deque[Hold] = deque(maxlen=_MOST_HOLDS)
        self._accounts: dict[int, Account] = {}

    def remember(self, hold: Hold) -> None:
        """Add a hold that has ended."""
        self._holds.append(hold)

    def forget(self) -> None:
        """Drop all memory: the reference did not go on from where it was."""
        self._holds.clear()
        self._accounts.clear()

    def gaps(self, t: float, z: Array, states: Mapping[int, HeardState]) -> Array:
        """Gaps at time t, -∞ without a share; shape (n,) for n peers that were heard, in order.

        Args:
            t: of the sample [s], at which the last hold has ended.
            z: the reference, shape (2 axes,).
            states: newest state heard of each peer, by its index.
        """
        parts: list[tuple[int, Hold]] = []
        for index, state in states.items():
            account = self._accounts.get(index)
            if account is not None and account.state.t == state.t:
                parts += [(index, hold) for hold in list(self._holds)[-1:]]
            elif (holds := self._since(state.t, t, z)) is not None:
                self._accounts[index] = self._opened(index, state, holds[0].z)
                parts += [(index, hold) for hold in holds if hold.end > hold.t]
            else:
                self._accounts.pop(index, None)
        for (index, _), closing in zip(parts, self._closings(parts), strict=True):
            self._accounts[index] = self._updated(self._accounts[index], closing)
        way = self._motion.stopping(_speed(z))
        return np.array([self._gap(index, t, way) for index in states])

    def _since(self, begin: float, t: float, z: Array) -> list[Hold] | None:
        """The holds since a time, the first one cut; None where memory does not reach so far."""
        if begin >= t:
            return [Hold(t, z, z, t)]
        holds = []
        for hold in reversed(self._holds):
            holds.append(hold)
            if hold.t <= begin:
                z = after(hold, begin, self._motion.drag)
                holds[-1] = Hold(begin, z, hold.u, hold.end)
                return holds[::-1]
        return None

    def _opened(self, index: int, state: HeardState, z: Array) -> Account:
        """An account of a peer that was at state.z when the own reference was z."""
        axes = self._motion.axes
        distance = float(length(z[:axes] - state.z[:axes]))
        peer = self._motions.of([index])
        other = float(peer.tube[0] + peer.stopping(length(state.z[None, axes:]))[0])
        apart = distance - self._radius - self._motion.tube - other
        return Account(state, apart, self._motion.stopping(_speed(z)), fastest=_speed(z))

    def _closings(self, parts: Sequence[tuple[int, Hold]]) -> Iterator[_Closing]:
        """Bounds on the way closed in during each hold on the peer."""
        if not parts:
            return iter(())
        motion, axes = self._motion, self._motion.axes
        motions = self._motions.of([index for index, _ in parts])
        states = [self._accounts[index].state for index, _ in parts]
        begin = np.array([hold.t for _, hold in parts])
        z, u = (np.array(rows) for rows in zip(*((h.z, h.u) for _, h in parts), strict=True))
        times = np.array([hold.end - hold.t for _, hold in parts])[:, None] * _PARTS
        own = Own(z[:, :axes], z[:, axes:], motion.drag, motion.authority)
        around = cones(own, self._enclose(states, begin, motions), motions, times)
        factors = held(np.array(motion.drag), times[..., None])
        v = factors.decay * z[:, None, axes:] + factors.speed * u[:, None]
        spans = times[:, 1:] - times[:, :-1]
        ends = v[:, :-1], v[:, 1:]
        most = spans * np.maximum(*(around.closing(end) for end in ends))
        back = spans * np.maximum(*(around.closing(-end) for end in ends))
        speed = length(v)
        columns = most, -back, np.maximum(back, 0.0)
        sums = [np.add.reduce(column, axis=1) for column in columns]
        rows = zip(*sums, _slowest(v[:, 0], v[:, -1]), speed.max(axis=1), strict=True)
        return (_Closing(*map(float, row)) for row in rows)

    def _updated(self, account: Account, closing: _Closing) -> Account:
        """The account after one more hold."""
        slowest = self._motion.stopping(closing.slowest)
        back = account.way - slowest - account.least + closing.opened
        return account._replace(
            closed=account.closed + closing.most,
            least=account.least + closing.least,
            regained=max(account.regained, back),
            fastest=max(account.fastest, closing.fastest),
        )

    def _gap(self, index: int, t: float, way: float) -> float:
        """The gap to a peer; way: the own L now."""
        account = self._accounts.get(index)
        if account is None or not _keeps_its_half(account.state) or account.apart < account.way:
            return -np.inf
        age = max(0.0, t - account.state.t) + self._stamp_error
        whole = account.apart - account.way + account.regained
        spent = way - account.way + account.closed
        rest = _rest(self._share, float(self._motions.longest[index]), age)
        # An own way at another time than the stamp's counts in g_s, C and C⁻.
        error = self._stamp_error
        unsure = 2.0 * error * self._motion.rate(account.fastest, error) if error > 0.0 else 0.0
        return whole * rest - account.regained - spent - unsure


def _keeps_its_half(state: HeardState) -> bool:
    """Return whether all that the peer did since was chosen at the state, or later."""
    axes = len(state.u)
    started_moving = state.t <= 0.0 and bool((state.z[axes:] != 0.0).any())
    return state.t_apply <= state.t and not started_moving


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
