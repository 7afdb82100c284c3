"""Which broadcasts exist for whom: a rule in virtual time alone, the same for every engine.

An agent's broadcast goes to those whom it sees, and who see it, in the sample that it answers: who
gets it knows that the pair is among its sender's own. A *contact* of i with j begins with the first
broadcast of j that goes to i, and it ends when one goes out that does not, or when i takes a sample
in which it does not see j. What was sent in a contact that has ended counts no more: from then on i
knows nothing of j's input, and counts it at its worst until a new contact has begun and its first
broadcast is there.
"""

import math
from collections import deque
from collections.abc import Sequence

from phalanx_plant.sampling.sensing import Sight


class Contacts:
    """The contacts of all agents."""

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
