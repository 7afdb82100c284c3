"""Who sees whom, and which broadcasts exist for each because of that.

An agent's broadcast goes to those whom it sees, and who see it, in the sample that it answers: who
gets it knows that the pair is among its sender's own. A *contact* of i with j begins with the first
broadcast of j that goes to i, and it ends when one goes out that does not, or when i takes a sample
in which it does not see j. What was sent in a contact that has ended counts no more: from then on i
knows nothing of j's input, and counts it at its worst until a new contact has begun and its first
broadcast is there.
"""

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm


class Sight(NamedTuple):
    """What an agent's sample tells it of others, and who is told of its answer."""

    seen: tuple[int, ...]
    """Whom it sees, itself included, in order."""
    hearers: tuple[int, ...]
    """Those among them who see it too, and listen to it: they get its broadcast."""

    def without(self, silent: Callable[[int], bool]) -> "Sight":
        """The same, but for those who are dead or stand still: they hear nothing."""
        return self._replace(hearers=tuple(l for l in self.hearers if not silent(l)))


class Sensing:
    """The sensing of all agents: true positions against each one's radius.

    Every agent looks at everybody, in one vectorised expression: up to 256 agents that takes less
    than a spatial index takes to build.
    """

    def __init__(self, swarm: Swarm) -> None:
        members = range(len(swarm.members))
        radii = sensing_radii(swarm)
        self._reach = radii * radii
        self._everybody = tuple(members)
        heard = [frozenset(swarm.heard_by(i)) for i in members]
        self._listeners = [tuple(i for i in members if j in heard[i]) for j in members]
        self._listening = [frozenset(each) for each in self._listeners]
        self._limited = bool(np.isfinite(self._reach).any())

    def sights(self, p: Array, who: Sequence[int]) -> list[Sight]:
        """Of each agent in `who`, where the true output positions are p [m], shape (N, d)."""
        if not self._limited:
            return [Sight(self._everybody, self._listeners[i]) for i in who]
        return [self._sight(p, i) for i in who]

    def sees(self, p: Array, i: int, others: Sequence[int]) -> bool:
        """Whether agent i sees any of these others, where output positions are p [m], (N, d)."""
        return bool((_squared(p[others] - p[i]) <= self._reach[i]).any())

    def _sight(self, p: Array, i: int) -> Sight:
        apart = _squared(p - p[i])
        seen = np.flatnonzero(apart <= self._reach[i])
        mutual = seen[apart[seen] <= self._reach[seen]].tolist()
        listeners = self._listening[i]
        return Sight(tuple(seen.tolist()), tuple(l for l in mutual if l in listeners))


def sensing_radii(swarm: Swarm) -> Array:
    """Each agent's radius [m], shape (N,); infinite where it sees everything."""
    radii = [swarm.sensing(i) for i in range(len(swarm.members))]
    return np.array([np.inf if r is None else r for r in radii])


def _squared(apart: Array) -> Array:
    """Squared lengths of some vectors, shape (r, d)."""
    # A fixed order of summation: who is seen must not depend on a vector unit.
    x, *others = (apart * apart).T
    total: Array = sum(others, x)
    return total


class Contacts:
    """Which broadcasts exist for whom: a rule in virtual time alone, the same for every engine."""

    def __init__(self, agents: int, latency: float) -> None:
        """latency: from a sample to its broadcast [s]."""
        self._latency = latency
        self._first: list[dict[int, int]] = [{} for _ in range(agents)]
        """For each agent, by sender: number of the first broadcast of their contact."""
        self._heard: list[tuple[int, ...]] = [() for _ in range(agents)]
        """For each agent, whom its newest broadcast goes to."""
        never = (-math.inf, -1)
        self._sent = [deque([never, never], maxlen=2) for _ in range(agents)]
        """For each agent, (time, number) of its last two broadcasts: the last before any t."""

    def existing(
        self, i: int, t: float, seen: Sequence[int]
    ) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """First and last number of the broadcasts that exist for agent i before t [s].

        One of each for every agent seen, -1 where there are none.
        """
        # Not at t: agents that update together do not hear each other.
        found, firsts = [], self._first[i]
        for j in seen:
            first = firsts.get(j, -1)
            (_, before), (sent, newest) = self._sent[j]
            latest = newest if sent < t else before
            found.append((first, latest) if 0 <= first <= latest else (-1, -1))
        since, latest_of = zip(*found, strict=True)
        return since, latest_of

    def forget(self, i: int) -> tuple[int, ...]:
        """All that agent i has received is lost. Returns of whom it had received something."""
        forgotten, self._first[i] = self._first[i], {}
        return tuple(sorted(forgotten))

    def sampled(self, i: int, k: int, t: float, sight: Sight) -> None:
        """Agent i takes sample k at t [s]: its broadcast k will go to those who hear it."""
        seen = set(sight.seen)
        self._first[i] = {j: first for j, first in self._first[i].items() if j in seen}
        for l in set(self._heard[i]).difference(sight.hearers):
            self._first[l].pop(i, None)
        for l in sight.hearers:
            self._first[l].setdefault(i, k)
        self._heard[i] = sight.hearers
        self._sent[i].append((t + self._latency, k))
