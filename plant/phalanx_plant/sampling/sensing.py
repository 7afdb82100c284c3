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
    """The agents in one agent's sample."""

    seen: tuple[int, ...]
    """Agents that it sees, itself included, in order."""
    hearers: tuple[int, ...]
    """Those among them that see it too, and listen to it: they receive its broadcast."""

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
        self._limited = bool(np.isfinite(self._reach).any())

    def visible(self, p: Array, agents: Sequence[int]) -> list[Visibility]:
        """Return the visibility of these agents, for true output positions p [m], (N, d)."""
        if not self._limited:
            return [Visibility(self._all, self._listeners[i]) for i in agents]
        return [self._visible_to(p, i) for i in agents]

    def sees(self, p: Array, i: int, others: Sequence[int]) -> bool:
        """Return whether agent i sees any of these others, for output positions p [m], (N, d)."""
        return bool((_squared(p[others] - p[i]) <= self._reach[i]).any())

    def _visible_to(self, p: Array, i: int) -> Visibility:
        distances = _squared(p - p[i])
        (seen,) = (distances <= self._reach[i]).nonzero()
        mutual = seen[distances[seen] <= self._reach[seen]].tolist()
        listeners = self._listening[i]
        return Visibility(tuple(seen.tolist()), tuple([l for l in mutual if l in listeners]))


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

    def existing(
        self, i: int, t: float, senders: Sequence[int]
    ) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """First and last number of the broadcasts that exist for agent i before t [s].

        One of each for every sender, -1 where there are none.
        """
        # Not at t: agents that update together do not receive each other's inputs.
        firsts, since = self._first[i], [-1 for _ in senders]
        latest = since.copy()
        for index, j in enumerate(senders):
            (_, before), (at, newest) = self._broadcasts[j]
            k = newest if at < t else before
            if j in firsts and firsts[j] <= k:
                since[index], latest[index] = firsts[j], k
        return tuple(since), tuple(latest)

    def forget(self, i: int) -> tuple[int, ...]:
        """Drop all that agent i has received, and return its senders."""
        forgotten, self._first[i] = self._first[i], {}
        return tuple(sorted(forgotten))

    def sampled(self, i: int, k: int, t: float, visible: Visibility) -> None:
        """Record that agent i takes sample k at t [s]: its broadcast k will go to its hearers."""
        firsts, seen, hearers = self._first, visible.seen, visible.hearers
        if not firsts[i].keys() <= set(seen):
            firsts[i] = {j: firsts[i][j] for j in seen if j in firsts[i]}
        if hearers != self._heard[i]:
            for l in set(self._heard[i]).difference(hearers):
                firsts[l].pop(i, None)
            self._heard[i] = hearers
        for l in hearers:
            if i not in firsts[l]:
                firsts[l][i] = k
        self._broadcasts[i].append((t + self._latency, k))
