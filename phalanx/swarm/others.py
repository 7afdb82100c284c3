"""The other members as an agent's rule counts them: W of its peers and A of all, kind by kind."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from phalanx.promise.capsules import Capsules, joined
from phalanx.promise.exit import Chasers
from phalanx.promise.hold import Fallback
from phalanx.promise.reach import Reach
from phalanx.swarm.committed import CommittedPoint, committed_point, fallback_of, reach_of, trusted
from phalanx.swarm.points import MovedByVelocity
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index


class Kind(NamedTuple):
    """Other members of one group, n of them."""

    members: Index
    """shape (n,)"""
    states: Index
    """Of each in the stacked state, shape (n, states)."""
    reach: Reach
    peer: tuple[CommittedPoint, Fallback] | None
    """Of a normal agent; None of one that is not trusted to keep the rule."""

    def expected(self, x: Array, places: Array) -> Capsules | None:
        """Return W of each; None of members that are no peers."""
        if self.peer is None:
            return None
        point, fallback = self.peer
        p = places[self.members]
        points = np.concatenate([p, np.zeros_like(p)], axis=1)
        return fallback.expected(points if fallback.motion.jumps else point.of(x[self.states]))


class Others:
    """All members but agent i."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """swarm: as agent i knows it, with dynamics that bound how far each can get."""
        self._i, self._axes, self._count = i, swarm.groups[i].axes, len(swarm.members)
        self.peers, self._kinds = trusted(swarm, i), list[Kind]()
        states = [range(part.start, part.stop) for part in swarm.safe_set.parts]
        for number in dict.fromkeys(swarm.group_numbers):
            same = [l for l, n in enumerate(swarm.group_numbers) if n == number and l != i]
            if same:
                indices, peer = np.array([states[l] for l in same], dtype=np.intp), None
                if same[0] in self.peers:
                    peer = committed_point(swarm, same[0]), fallback_of(swarm, same[0])
                members = np.array(same, dtype=np.intp)
                self._kinds.append(Kind(members, indices, reach_of(swarm, same[0]), peer))

    def expected(self, near: Index, x: Array, places: Array) -> Capsules:
        """Return W of those peers that are near, in the order of members."""
        tubes = [kind.expected(x, places) for kind in self._of(near)]
        return joined([tube for tube in tubes if tube is not None], self._axes)

    def reached(self, near: Index, x: Array, places: Array, time: float) -> Capsules:
        """Return A, within a time [s], of those that are near, in the order of members."""
        return joined(
            [k.reach.within(x[k.states], places[k.members], time) for k in self._of(near)],
            self._axes,
        )

    def chasers(self, near: Index, x: Array, places: Array, time: float) -> Chasers:
        """Return those that are near and keep no rule, in the order of members.

        time: for which those are counted that are as fast as the exit [s].
        """
        kinds = [kind for kind in self._of(near) if kind.peer is None]
        ways = [kind.reach.for_ever(state) for kind in kinds for state in x[kind.states]]
        offsets, speeds = np.array(ways).reshape(-1, 2).T
        members = [l for kind in kinds for l in kind.members.tolist()]
        return Chasers(places[members], offsets, speeds, np.full(len(speeds), time))

    def farthest(self, swarm: Swarm, time: float, chased: bool) -> Array:
        """Return how far W and A of each reach from its place at any state, shape (N,) [m].

        Infinite where that has no bound. time: for A [s]; chased: whether W alone counts of peers,
        and all that others ever reach.
        """
        bounds, x = np.zeros(self._count), swarm.start()
        places = swarm.positions(x)
        for kind in self._kinds:
            free = not isinstance(kind.reach.dynamics, MovedByVelocity)
            if free or (chased and kind.peer is None):
                bounds[kind.members] = np.inf
                continue
            reach = kind.reach.within(x[kind.states[:1]], places[kind.members[:1]], time)
            expected = kind.expected(x, places)
            widths = [0.0 if chased else reach.radius[0], expected.radius[0] if expected else 0.0]
            bounds[kind.members] = max(widths)
        return bounds

    def closing(self, swarm: Swarm) -> Array:
        """Return how fast agent i, alone at its own index, or with another closes a gap [m/s].

        Shape (N,), of members that inputs move by velocities.
        """
        x, parts = swarm.start(), swarm.safe_set.parts
        speeds = np.zeros(self._count)
        for kind in self._kinds:
            speeds[kind.members] = kind.reach.for_ever(x[kind.states[0]])[1]
        return speeds + reach_of(swarm, self._i).for_ever(x[parts[self._i]])[1]

    def _of(self, near: Index) -> Iterator[Kind]:
        which = np.zeros(self._count, dtype=bool)
        which[near] = True
        for kind in self._kinds:
            rows = which[kind.members]
            if rows.any():
                yield kind._replace(members=kind.members[rows], states=kind.states[rows])
