"""Times of samples and inputs: the agents' clocks, and the links on board each robot."""

import math
from collections import Counter
from collections.abc import Sequence
from typing import Protocol

from phalanx.network.link import Kind, Link, RuleError
from phalanx.swarm.swarm import Swarm
from phalanx_plant.world.events import SwarmBrokenError


class OnboardLinks:
    """Links on board each robot: from sensor to controller, and from controller to actuator."""

    def __init__(self, swarm: Swarm) -> None:
        self.faults: Counter[int] = Counter()
        """Messages on which each declared fault had an effect."""
        self._sensors = _links(swarm, "sample")
        self._actuators = _links(swarm, "actuation")
        self._end = swarm.scenario.duration

    def brings_sample(self, i: int, tick: int, t: float, now: float = 0.0) -> bool:
        """Return whether agent i's sample at this tick of its clock, at t [s], arrives.

        now: when this is decided [s].

        A delayed sample is lost: it is used when it is taken, or not at all. After the end of the
        run nothing is lost.
        """
        return t >= self._end or self._delay(self._sensors[i], tick, t, now) == 0.0

    def input_delay(self, i: int, k: int, t: float, now: float = 0.0) -> float | None:
        """Delay after t [s] of the input for agent i's sample k; None if it is lost.

        now: when this is decided [s].
        """
        return self._delay(self._actuators[i], k, t, now)

    def _delay(self, link: Link, number: int, t: float, now: float) -> float | None:
        if link.free:
            return 0.0
        try:
            delivery = link.fate(number, t, 0.0, now)
        except RuleError as error:
            raise SwarmBrokenError(f"a robot's own link: {error}") from error
        for fault in delivery.faults:
            self.faults[fault] += 1
        return delivery.delay


def _links(swarm: Swarm, kind: Kind) -> list[Link]:
    seeds, models = swarm.seeds, swarm.links
    return [Link(seeds, name, name, models.model(name, name, kind), kind) for name in swarm.names]


class Clock(Protocol):
    """An agent's sampling clock."""

    def after(self, k: int, t: float, now: float) -> float:
        """Time of the tick after tick k, which was at t [s]; decided now [s]."""


class Schedule:
    """The sampling instants of all agents and the instants at which their inputs take effect."""

    def __init__(self, clocks: Sequence[Clock], latency: float, links: OnboardLinks) -> None:
        """Begin at t = 0, where all agents sample.

        Args:
            clocks: of the agents.
            latency: from a sample to its input's effect [s].
            links: lose samples, and delay or lose inputs.
        """
        self._clocks, self._latency, self._links = clocks, latency, links
        self._now = 0.0
        """Time of the last sample [s], at which what comes next is decided."""
        self._k = [0 for _ in clocks]
        self._tick = [0 for _ in clocks]
        """Number of each clock's next tick at which no sample is lost."""
        self._next_sample = [0.0 for _ in clocks]
        self._due: dict[int, float] = {}
        """By agent, when its pending input takes effect or is found to be lost [s]."""
        self._lost = [False for _ in clocks]
        """By agent, whether the input for its newest sample is lost."""
        for i in range(len(clocks)):
            self._skip_lost(i)

    def next_event(self) -> float:
        """Time of the earliest sample or input [s]; infinite if there is none."""
        return min([*self._next_sample, *self._due.values()])

    def sampling_at(self, t: float) -> list[int]:
        """The agents that sample at t [s]."""
        return [i for i, due in enumerate(self._next_sample) if due <= t]

    def take_applying(self, t: float) -> list[int]:
        """The agents whose inputs take effect, or are found to be lost, at t [s], in order."""
        applying = sorted([i for i, due in self._due.items() if due <= t])
        for i in applying:
            del self._due[i]
        return applying

    def tick(self, i: int) -> float:
        """Time of the next tick of agent i's clock [s]."""
        return self._next_sample[i]

    def next_number(self, i: int) -> int:
        """The number of agent i's next sample."""
        return self._k[i]

    def sampled(self, i: int, t: float) -> int:
        """Record that agent i samples at t [s], and return the sample's number."""
        k, self._now = self._k[i], t
        self._k[i] = k + 1
        self.skip_tick(i)
        due = t + self._latency
        late = self._links.input_delay(i, k, due, t)
        # By then there may be a newer sample: an input that late is never applied.
        lost = late is None or (late > 0.0 and due + late >= self._next_sample[i])
        self._lost[i], self._due[i] = lost, due if late is None or lost else due + late
        return k

    def due(self, i: int) -> float:
        """Time at which agent i's pending input takes effect, or is found to be lost [s]."""
        return self._due[i]

    def loses_input(self, i: int) -> bool:
        """Return whether the input for agent i's newest sample never reaches its actuator."""
        return self._lost[i]

    def skip_tick(self, i: int) -> None:
        """Go on to the next tick of agent i's clock at which no sample is lost."""
        self._tick_on(i)
        self._skip_lost(i)

    def _tick_on(self, i: int) -> None:
        # The clock continues from its tick, not from when the plant reached it.
        tick, t = self._tick[i], self._next_sample[i]
        self._next_sample[i] = self._clocks[i].after(tick, t, self._now)
        self._tick[i] += 1

    def _skip_lost(self, i: int) -> None:
        brings = self._links.brings_sample
        while not brings(i, self._tick[i], self._next_sample[i], self._now):
            self._tick_on(i)

    def silence(self, i: int) -> None:
        """Let agent i sample no more."""
        self._next_sample[i] = math.inf

    def resume(self, i: int, t: float) -> None:
        """Let agent i sample again at t [s], but not before its last input has taken effect."""
        # Strictly after: a sample at the same instant would count a broadcast not yet sent.
        earliest = max(t, math.nextafter(self._due.get(i, -math.inf), math.inf))
        self._next_sample[i] = min(self._next_sample[i], earliest)
