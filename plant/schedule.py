"""Who samples when, and whose input takes effect when: pure."""

import math
from collections.abc import Sequence

from phalanx.seeded.clock import SamplingClock


class Schedule:
    """The sampling instants of all agents and the instants at which their inputs take effect."""

    def __init__(self, clocks: Sequence[SamplingClock], latency: float) -> None:
        """Everybody samples at 0; inputs take effect `latency` after their sample [s]."""
        self._clocks, self._latency = clocks, latency
        self._k = [0 for _ in clocks]
        self._next_sample = [0.0 for _ in clocks]
        self._due: dict[int, float] = {}
        """When each awaited input takes effect [s], by agent."""

    def next_event(self) -> float:
        """The earliest instant at which something is due [s]; infinite if nothing is."""
        return min([*self._next_sample, *self._due.values()])

    def sampling_at(self, t: float) -> list[int]:
        """The agents that sample at t [s]."""
        return [i for i, due in enumerate(self._next_sample) if due == t]

    def applying_at(self, t: float) -> list[int]:
        """The agents whose inputs take effect at t [s], in order."""
        return sorted(i for i, due in self._due.items() if due == t)

    def next_number(self, i: int) -> int:
        """The number of agent i's next sample."""
        return self._k[i]

    def sampled(self, i: int, t: float) -> int:
        """Agent i samples at t [s]; the sample's number."""
        k = self._k[i]
        self._next_sample[i] = self._clocks[i].after(k, t)
        self._k[i] = k + 1
        self._due[i] = t + self._latency
        return k

    def applied(self, i: int) -> None:
        """Agent i's input took effect."""
        del self._due[i]

    def awaits(self, i: int) -> bool:
        """Whether an input of agent i is on its way to its actuator."""
        return i in self._due

    def silence(self, i: int) -> None:
        """Agent i samples no more."""
        self._next_sample[i] = math.inf

    def resume(self, i: int, t: float) -> None:
        """Agent i samples again at t [s], but not before its last input has taken effect."""
        # Strictly after: a sample at the same instant would count a broadcast not yet sent.
        earliest = max(t, math.nextafter(self._due.get(i, -math.inf), math.inf))
        self._next_sample[i] = min(self._next_sample[i], earliest)
