"""The harness within each robot: samples that its sensors lose, inputs that come late or never."""

from collections import Counter

from phalanx.network.link import Kind, Link, Passage, RuleError
from phalanx.swarm.swarm import Swarm
from phalanx_plant.events.stop import SwarmBrokenError


class Harness:
    """Every robot's own links, from its sensors and to its actuators."""

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
    seed, models = swarm.scenario.seed, swarm.links
    return [Link(seed, name, name, models.model(name, name, kind), kind) for name in swarm.names]
