"""Sensing radii: the agents that each agent sees, and the broadcasts that exist for it.

An agent's broadcast goes to those agents that it sees, and that see it, in the sample that it
answers: a receiver knows that the pair is among its sender's own. A *contact* of i with j begins
with the first broadcast of j that goes to i. It ends with the first that does not, or when i takes
a sample in which it does not see j. Broadcasts of a contact that has ended count no more: from then
on i does not know j's input and assumes the worst, until the first broadcast of a new contact
arrives.
"""

import math
from collections import deque
from collections.abc import Sequence, Set
from typing import NamedTuple

import numpy as np

from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array


class Visibility(NamedTuple):
    """The agents in one agent's sample, and those who hear its broadcast."""

    seen: tuple[int, ...]
    """Agents that it sees, itself included, in order."""
    hearers: tuple[int, ...]
    """Those that receive its broadcast: they see each other and it listens, or by radio."""
    peers: tuple[int, ...] = ()
    """Agents that it knows by radio, and does not see."""
    distances: tuple[float, ...] = ()
    """To each that it sees, then to each peer [m]; empty without peers."""

    def without(self, silent: Set[int]) -> "Visibility":
        """Remove dead and paused agents from the hearers."""
        return self._replace(hearers=tuple([l for l in self.hearers if l not in silent]))


class Sensing:
    """The sensing of all agents, by their true positions.

    Distances to all agents are computed in one vectorised expression: up to 256 agents that takes
    less time than building a spatial index.
    """

    def __init__(self, swarm: Swarm) -> None:
        members = range(len(swarm.members))
        radii = sensing_radii(swarm)
        self._reach = radii * radii
        self._all = tuple(members)
        heard = [frozenset(swarm.heard_by(i)) for i in members]
        self._listeners = [tuple(i for i in members if j in heard[i]) for j in members]
        self._listening = [frozenset(agents) for agents in self._listeners]
        self._peers = [swarm.peers(i) for i in members]
        self._limited = bool(np.isfinite(self._reach).any()) or any(self._peers)

    def visible(self, p: Array, agents: Sequence[int]) -> list[Visibility]:
        """Return the visibility of these agents, for true output positions p [m], (N, d)."""
        if not self._limited:
            return [Visibility(self._all, self._listeners[i]) for i in agents]
        return [self._visible_to(p, i) for i in agents]

    def sees(self, p: Array, i: int, others: Sequence[int]) -> bool:
        """Return whether agent i sees any of these others, for output positions p [m], (N, d)."""
        return bool((_squared(p[others] - p[i]) <= self._reach[i]).any())

    def _visible_to(self, p: Array, i: int) -> Visibility:
        distances, peers = _squared(p - p[i]), self._peers[i]
        sensed = distances <= self._reach[i]
        sensed[list(peers)] = False
        (seen,) = sensed.nonzero()
        mutual, listeners = seen[distances[seen] <= self._reach[seen]].tolist(), self._listening[i]
        hearers = tuple([l for l in mutual if l in listeners])
        if not peers:
            return Visibility(tuple(seen.tolist()), hearers)
        everybody = [*seen.tolist(), *peers]
        lengths = tuple(np.sqrt(distances[everybody]).tolist())
        return Visibility(tuple(seen.tolist()), tuple(sorted({*hearers, *peers})), peers, lengths)


def sensing_radii(swarm: Swarm) -> Array:
    """Each agent's radius [m], shape (N,); infinite where it sees everything."""
    radii = [swarm.sensing(i) for i in range(len(swarm.members))]
    return np.array([np.inf if r is None else r for r in radii])


def _squared(vectors: Array) -> Array:
    """Squared lengths of vectors, shape (r, d)."""
    # A fixed order of summation: the result must not depend on a vector unit.
    first, *others = (vectors * vectors).T
    total: Array = first
    for component in others:
        total = total + component
    return total


class Contacts:
    """The broadcasts that exist for each agent, by virtual time alone, the same in every engine."""

    def __init__(self, agents: int, latency: float) -> None:
        """Begin without contacts; latency is from a sample to its broadcast [s]."""
        self._latency = latency
        self._first: list[dict[int, int]] = [{} for _ in range(agents)]
        """For each agent, by sender: number of the first broadcast of their contact."""
        self._heard: list[tuple[int, ...]] = [() for _ in range(agents)]
        """For each agent, the receivers of its newest broadcast."""
        never = (-math.inf, -1)
        self._broadcasts = [deque([never, never], maxlen=2) for _ in range(agents)]
        """For each agent, (time, number) of its last two broadcasts."""

    def existing(self, i: int, t: float, senders: Sequence[int]) -> list[tuple[int, int, int]]:
        """Return the broadcasts that exist for agent i before t [s]: (sender, first, last number).

        Senders without one are left out.
        """
        # Not at t: agents that update together do not receive each other's inputs.
        firsts, ranges = self._first[i], list[tuple[int, int, int]]()
        for j in senders:
            (_, before), (at, newest) = self._broadcasts[j]
            k = newest if at < t else before
            if j in firsts and firsts[j] <= k:
                ranges.append((j, firsts[j], k))
        return ranges

    def forget(self, i: int) -> tuple[int, ...]:
        """Drop all that agent i has received, and return its senders."""
        forgotten, self._first[i] = self._first[i], {}
        return tuple(sorted(forgotten))

    def sampled(self, i: int, k: int, t: float, visible: Visibility, broadcasts: bool) -> None:
        """Record that agent i takes sample k at t [s].

        broadcasts: whether its broadcast k will go to its hearers.
        """
        firsts, hearers = self._first, visible.hearers
        senders = {*visible.seen, *visible.peers}
        if not firsts[i].keys() <= senders:
            firsts[i] = {j: first for j, first in firsts[i].items() if j in senders}
        if hearers != self._heard[i]:
            for l in set(self._heard[i]).difference(hearers):
                firsts[l].pop(i, None)
            self._heard[i] = hearers
        for l in hearers:
            if i not in firsts[l]:
                firsts[l][i] = k
        if broadcasts:
            self._broadcasts[i].append((t + self._latency, k))
