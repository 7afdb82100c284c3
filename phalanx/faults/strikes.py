"""Whom a declared fault strikes, and when: at a time that is given, or at random with a rate."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from phalanx.seeded.draws import Draws

_GRAIN = 1e-3
"""Strikes at random begin at multiples of it [s]."""
MOST = 0.1 / _GRAIN
"""Highest rate [1/s]: one strike in a grain has to be as good as any number of them."""


class Strike(NamedTuple):
    """One agent, struck once."""

    agent: str
    begin: float
    """[s]"""
    end: float = math.inf
    """[s]; no longer in force at this instant."""

    def holds(self, t: float) -> bool:
        """Whether it is in force at t [s]."""
        return self.begin <= t < self.end


def at_random(
    rate: float, agents: Sequence[str], duration: float, draws: Draws
) -> Iterator[tuple[float, str]]:
    """Times up to `duration` [s], `rate` of them in a second on average, each with one agent.

    draws: of width 2. Compared alone, never put through a logarithm: the same times on every CPU.
    """
    for n in range(math.ceil(duration / _GRAIN)):
        happens, whom = draws[n].tolist()
        if happens < rate * _GRAIN:
            yield n * _GRAIN, agents[int(whom * len(agents))]
