"""All that a scenario declares to go wrong: numbered, and put together for each link or liar."""

from collections.abc import Callable, Iterator
from functools import partial

from phalanx.faults.lies import Lies
from phalanx.network.link import Kind, Link, LinkModel, Stage
from phalanx.network.rule import Rule
from phalanx.network.users_rule import UsersRule
from phalanx.network.window import Cut, During, Hold
from phalanx.scenario.faults import Fault, HoldFault, LinkFault, Partition
from phalanx.scenario.lies import LieFault
from phalanx.scenario.model import Scenario
from phalanx.scenario.network import LinkTable
from phalanx.scenario.strikes import all_struck
from phalanx.scenario.timed import Timed

_BASE: tuple[Kind, ...] = ("broadcast", "sample", "actuation")


class Links:
    """The models of a scenario's links. A rule's number is its place in `declared`."""

    def __init__(self, scenario: Scenario) -> None:
        self._network = network = scenario.network
        self._names = [name for name, _, _ in scenario.roster()]
        tables: list[tuple[str, LinkTable]] = [
            ("network", network),
            ("network.sample", network.sample),
            ("network.actuation", network.actuation),
        ]
        tables += [(f"network.links.{i}", link) for i, link in enumerate(network.links)]
        fields: list[str] = []
        self._static: list[Callable[[], tuple[Stage, ...]]] = []
        """What each table asks for at all times, for one more link."""
        for where, table in tables:
            stages = partial(_stages, table, len(fields))
            fields += [f"{where}.{stage.field}" for stage in stages()]
            # Those built in remember nothing, and serve any number of links.
            self._static.append(stages if table.rules else partial(tuple, stages()))
        self._first_fault = len(fields)
        self._faults = scenario.faults
        self._seed = scenario.seed
        self._cuts = [self._cut(place, fault) for place, fault in enumerate(self._faults)]
        self._silenced = [each for each in all_struck(scenario) if each.fault.cuts]
        self.declared = (
            *fields,
            *(f"faults.{place} ({fault.kind})" for place, fault in enumerate(self._faults)),
        )
        """What each rule is called in a summary."""

    def model(self, sender: str, receiver: str, of: Kind = "broadcast") -> LinkModel:
        """The model of one link: faults of a time, what the link always does, holds.

        A user's rules are this link's own: they may keep what they were asked. Both ends of a
        robot's own links, of samples and actuations, are called like it.
        """
        static = self._static[_BASE.index(of)]
        for place, exception in enumerate(self._network.links):
            if exception.concerns(sender, receiver, of):
                static = self._static[len(_BASE) + place]
        link = sender, receiver, of
        within = self._within(receiver, of)
        return LinkModel((*within, *self._timed(*link), *static(), *self._holds(*link)))

    def users_rules(self) -> Iterator[tuple[str, str, Link]]:
        """Each rule of a user's anew, alone on a link that may have it, with its two ends."""
        network, first, last = self._network, self._names[0], self._names[-1]
        bases = zip((network, network.sample, network.actuation), _BASE, strict=True)
        tables: list[tuple[LinkTable, Kind, str, str]] = [(t, of, "*", "*") for t, of in bases]
        tables += [(t, t.of, t.sender, t.receiver) for t in network.links]
        faults = (fault for fault in self._faults if isinstance(fault, LinkFault))
        tables += [(t, t.of, t.sender, t.receiver) for t in faults]
        for table, of, sender, receiver in tables:
            if sender == "*":
                sender = first if of == "broadcast" or receiver == "*" else receiver
            if receiver == "*":
                receiver = last if of == "broadcast" else sender
            for stage in _stages(table, 0):
                if isinstance(stage.rule, UsersRule):
                    model = LinkModel((stage,))
                    yield sender, receiver, Link(self._seed, sender, receiver, model, of)

    def lies(self, name: str) -> Lies:
        """What an agent makes of the truth before it tells its peers."""
        own = {
            self._first_fault + place: fault
            for place, fault in enumerate(self._faults)
            if isinstance(fault, LieFault) and fault.agent == name and not fault.silent
        }
        lies = tuple(fault.declared(number) for number, fault in own.items())
        reach = max((fault.replay or 0 for fault in own.values()), default=0)
        return Lies(self._seed, name, lies, reach)

    def _cut(self, place: int, fault: Fault) -> frozenset[tuple[str, str]]:
        """Links (sender, receiver) that carry no broadcast in the time of a fault."""
        if isinstance(fault, Partition):
            return fault.cut(self._names, self._seed, place)
        return fault.cut(self._names) if isinstance(fault, LieFault) else frozenset()

    def _timed(self, sender: str, receiver: str, of: Kind) -> Iterator[Stage]:
        for place, (fault, cut) in enumerate(zip(self._faults, self._cuts, strict=True)):
            if isinstance(fault, Timed) and of == "broadcast" and (sender, receiver) in cut:
                yield self._stage(place, fault.during(Cut()))
            if isinstance(fault, LinkFault) and fault.concerns(sender, receiver, of):
                for _, rule in fault.fields():
                    yield self._stage(place, fault.during(rule))

    def _holds(self, sender: str, receiver: str, of: Kind) -> Iterator[Stage]:
        for place, fault in enumerate(self._faults):
            if isinstance(fault, HoldFault) and fault.concerns(sender, receiver, of):
                yield self._stage(place, fault.during(Hold(fault.end)))

    def _within(self, agent: str, of: Kind) -> Iterator[Stage]:
        for place, fault, (name, begin, end) in self._silenced:
            if (name, fault.cuts) == (agent, of):
                yield self._stage(place, During(begin, end, Cut()))

    def _stage(self, place: int, rule: Rule) -> Stage:
        return Stage(f"faults.{place}", rule, self.number(place))

    def number(self, place: int) -> int:
        """The number of the fault at this place of [[faults]]."""
        return self._first_fault + place


def _stages(table: LinkTable, first: int) -> tuple[Stage, ...]:
    """A table's rules, built anew, with their numbers."""
    return tuple(Stage(*rule, first + n) for n, rule in enumerate(table.fields()))
