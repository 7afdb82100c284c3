"""Who samples when, and whose input takes effect when: clocks, and the links within each robot."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from phalanx.network.link import Kind, Link, Passage, RuleError
from phalanx.swarm.swarm import Swarm
from phalanx_plant.world.events import SwarmBrokenError


class Harness:
    """Every robot's own links: samples that its sensors lose, inputs that come late or never."""

    def __init__(self, swarm: Swarm) -> None:
        self.faults: Counter[int] = Counter()
        """Messages on which each declared fault had an effect."""
        self._sensors = _links(swarm, "sample")
        self._actuators = _links(swarm, "actuation")
        self._end = swarm.scenario.duration

    def brings_sample(self, i: int, tick: int, t: float) -> bool:
        """Whether agent i takes a sample at its clock's tick of this number, at t [s].

        One that a rule delays is lost: a sample is used when it is taken, or it is missed. After
        the end of the run nothing is lost any more.
        """
        return t >= self._end or self._decided(self._sensors[i], tick, t).delay == 0.0

    def input_delay(self, i: int, k: int, t: float) -> float | None:
        """How much later than t [s] the input for agent i's sample k comes; None if it is lost."""
        return self._decided(self._actuators[i], k, t).delay

    def _decided(self, link: Link, number: int, t: float) -> Passage:
        try:
            passage = link.fate(number, t, 0.0)
        except RuleError as error:
            raise SwarmBrokenError(f"a robot's own link: {error}") from error
        for fault in passage.faults:
            self.faults[fault] += 1
        return passage


def _links(swarm: Swarm, kind: Kind) -> list[Link]:
    seed, models = swarm.seed, swarm.links
    return [Link(seed, name, name, models.model(name, name, kind), kind) for name in swarm.names]


class Clock(Protocol):
    """When an agent samples."""

    def after(self, k: int, t: float) -> float:
        """When its tick after tick k is, which was at t [s]."""


class Schedule:
    """The sampling instants of all agents and the instants at which their inputs take effect."""

    def __init__(self, clocks: Sequence[Clock], latency: float, harness: Harness) -> None:
        """Everybody samples at 0; inputs take effect `latency` after their sample [s].

        harness: loses samples, and brings inputs late or never.
        """
        self._clocks, self._latency, self._harness = clocks, latency, harness
        self._k = [0 for _ in clocks]
        self._tick = [0 for _ in clocks]
        """Number of each clock's next tick: one at which no sample is lost."""
        self._next_sample = [0.0 for _ in clocks]
        self._due: dict[int, float] = {}
        """When each awaited input takes effect, or is found to be lost [s], by agent."""
        self._lost: set[int] = set()
        """Whose awaited inputs are lost."""
        for i in range(len(clocks)):
            self._skip_lost(i)

    def next_event(self) -> float:
        """The earliest instant at which something is due [s]; infinite if nothing is."""
        return min([*self._next_sample, *self._due.values()])

    def sampling_at(self, t: float) -> list[int]:
        """The agents that sample at t [s]."""
        return [i for i, due in enumerate(self._next_sample) if due <= t]

    def applying_at(self, t: float) -> list[int]:
        """The agents whose inputs take effect at t [s], in order."""
        return sorted(i for i, due in self._due.items() if due <= t)

    def tick(self, i: int) -> float:
        """When agent i's clock next ticks [s]."""
        return self._next_sample[i]

    def next_number(self, i: int) -> int:
        """The number of agent i's next sample."""
        return self._k[i]

    def sampled(self, i: int, t: float) -> int:
        """Agent i samples at t [s]; the sample's number."""
        k = self._k[i]
        self._k[i] = k + 1
        self._tick_on(i)
        self._skip_lost(i)
        due = t + self._latency
        late = self._harness.input_delay(i, k, due)
        if late is None or (late and due + late >= self._next_sample[i]):
            # By then there is a newer sample: an input that late is never applied.
            self._lost.add(i)
        else:
            due += late
        self._due[i] = due
        return k

    def due(self, i: int) -> float:
        """When agent i's awaited input takes effect, or is found to be lost [s]."""
        return self._due[i]

    def loses_input(self, i: int) -> bool:
        """Whether agent i's awaited input never comes to its actuator."""
        return i in self._lost

    def applied(self, i: int) -> None:
        """Agent i's input took effect, or was found to be lost."""
        del self._due[i]
        self._lost.discard(i)

    def pass_over(self, i: int) -> None:
        """Agent i takes no sample at the next tick of its clock."""
        self._tick_on(i)
        self._skip_lost(i)

    def _tick_on(self, i: int) -> None:
        # The clock goes on from its tick, not from when the plant came to it.
        self._next_sample[i] = self._clocks[i].after(self._tick[i], self._next_sample[i])
        self._tick[i] += 1

    def _skip_lost(self, i: int) -> None:
        while not self._harness.brings_sample(i, self._tick[i], self._next_sample[i]):
            self._tick_on(i)

    def silence(self, i: int) -> None:
        """Agent i samples no more."""
        self._next_sample[i] = math.inf

    def resume(self, i: int, t: float) -> None:
        """Agent i samples again at t [s], but not before its last input has taken effect."""
        # Strictly after: a sample at the same instant would count a broadcast not yet sent.
        earliest = max(t, math.nextafter(self._due.get(i, -math.inf), math.inf))
        self._next_sample[i] = min(self._next_sample[i], earliest)
