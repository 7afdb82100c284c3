"""Who sees whom: true positions against each agent's sensing radius."""

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
    """The sensing of all agents.

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
