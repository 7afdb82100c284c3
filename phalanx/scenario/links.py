"""All that a scenario declares to go wrong on links: numbered, and put together for each link."""

from collections.abc import Iterator

from phalanx.network.link import Kind, LinkModel, Stage
from phalanx.network.rule import Rule
from phalanx.network.window import Cut, Hold
from phalanx.scenario.faults import Fault, HoldFault, LinkFault, Partition
from phalanx.scenario.model import Scenario
from phalanx.scenario.network import LinkTable

_BASE: tuple[Kind, ...] = ("broadcast", "sample", "actuation")


class Links:
    """The models of a scenario's links. A rule's number is its place in `declared`."""

    def __init__(self, scenario: Scenario) -> None:
        network = scenario.network
        self._names = [name for name, _, _ in scenario.roster()]
        self._tables: list[tuple[str, LinkTable]] = [
            ("network", network),
            ("network.sample", network.sample),
            ("network.actuation", network.actuation),
        ]
        self._tables += [(f"network.links.{i}", link) for i, link in enumerate(network.links)]
        self._exceptions = network.links
        fields = [
            f"{where}.{field}" for where, table in self._tables for field, _ in table.fields()
        ]
        self._first_fault = len(fields)
        self._faults = scenario.faults
        self._cuts = [
            fault.cut(self._names, scenario.seed, place) if isinstance(fault, Partition) else None
            for place, fault in enumerate(self._faults)
        ]
        self.declared = (
            *fields,
            *(f"faults.{place} ({fault.kind})" for place, fault in enumerate(self._faults)),
        )
        """What each rule is called in a summary."""

    def model(self, sender: str, receiver: str, of: Kind = "broadcast") -> LinkModel:
        """The model of one link: faults of a time, what the link always does, holds.

        Both ends of a robot's own links, of samples and actuations, are called like it.
        """
        where, table = self._tables[_BASE.index(of)]
        for place, exception in enumerate(self._exceptions):
            if exception.concerns(sender, receiver, of):
                where, table = self._tables[len(_BASE) + place]
        static = (
            Stage(field, rule, self.declared.index(f"{where}.{field}"))
            for field, rule in table.fields()
        )
        link = sender, receiver, of
        return LinkModel((*self._timed(*link), *static, *self._holds(*link)))

    def _timed(self, sender: str, receiver: str, of: Kind) -> Iterator[Stage]:
        for place, (fault, cut) in enumerate(zip(self._faults, self._cuts, strict=True)):
            if cut is not None and of == "broadcast" and (sender, receiver) in cut:
                yield self._stage(place, fault, Cut())
            if isinstance(fault, LinkFault) and fault.concerns(sender, receiver, of):
                for _, rule in fault.fields():
                    yield self._stage(place, fault, rule)

    def _holds(self, sender: str, receiver: str, of: Kind) -> Iterator[Stage]:
        for place, fault in enumerate(self._faults):
            if isinstance(fault, HoldFault) and fault.concerns(sender, receiver, of):
                yield self._stage(place, fault, Hold(fault.end))

    def _stage(self, place: int, fault: Fault, rule: Rule) -> Stage:
        return Stage(f"faults.{place}", fault.during(rule), self._first_fault + place)
