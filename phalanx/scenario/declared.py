"""Link models and faults that a scenario declares: numbered, and combined for each link."""

from collections.abc import Callable, Iterator
from functools import cached_property, partial
from typing import Annotated, get_args

from pydantic import Field

from phalanx.faults.fault import AgentFault, LinkEnds, Occurrence, RunFacts
from phalanx.faults.lies import LieFault, Lies
from phalanx.faults.links import AnyLinkFault, LinkFault
from phalanx.faults.onboard import AnyOnboardFault
from phalanx.faults.process import ProcessFault
from phalanx.network.link import Kind, Link, LinkModel, Stage
from phalanx.network.rule import During, Rule
from phalanx.network.table import LinkTable, Network
from phalanx.theory.expressions.user_methods import is_built_in

AnyFault = Annotated[
    AnyLinkFault | LieFault | ProcessFault | AnyOnboardFault,
    Field(discriminator="kind"),
]
KINDS = frozenset(
    kind
    for model in get_args(get_args(AnyFault)[0])
    for kind in get_args(model.model_fields["kind"].annotation)
)
"""Kinds of all faults."""

_BASE: tuple[Kind, ...] = ("broadcast", "sample", "actuation")


class Links:
    """The models of a run's links, and its faults of agents.

    The number of a rule or fault is its index in `declared`.
    """

    def __init__(self, network: Network, faults: tuple[AnyFault, ...], run: RunFacts) -> None:
        self._network, self._faults, self._run = network, faults, run
        self.seeds = run.seeds
        """Of all that the run draws."""
        tables: list[tuple[str, LinkTable]] = [
            ("network", network),
            ("network.sample", network.sample),
            ("network.actuation", network.actuation),
        ]
        tables += [(f"network.links.{i}", link) for i, link in enumerate(network.links)]
        fields: list[str] = []
        self._static: list[Callable[[], tuple[Stage, ...]]] = []
        """Builds each table's permanent rules for one more link."""
        for where, table in tables:
            stages = partial(_stages, table, len(fields))
            fields += [f"{where}.{stage.field}" for stage in stages()]
            # Built-in rules have no state, so all links share them.
            self._static.append(stages if table.rules else partial(tuple, stages()))
        self._first_fault = len(fields)
        self.declared = (
            *fields,
            *(f"faults.{place} ({fault.kind})" for place, fault in enumerate(faults)),
        )
        """Names of all rules and faults, as in a summary."""
        in_order = sorted(enumerate(faults), key=lambda each: each[1].order)
        rules = [(f.order, place, f.on_links(run, place)) for place, f in in_order]
        self._before = [(place, found) for order, place, found in rules if order < 0]
        self._after = [(place, found) for order, place, found in rules if order > 0]

    def model(self, sender: str, receiver: str, of: Kind = "broadcast") -> LinkModel:
        """Return the model of one link: faults, the link's own rules, and faults that act last.

        A user's rules may have a state, so they are built for each link. A link within a robot has
        the robot's name at both ends.
        """
        static = self._static[_BASE.index(of)]
        for place, exception in enumerate(self._network.links):
            if exception.concerns(sender, receiver, of):
                static = self._static[len(_BASE) + place]
        link = LinkEnds(sender, receiver, of)
        before, after = (
            [
                Stage(_field(place, rule), rule, self._first_fault + place)
                for place, rules in group
                for rule in rules(link)
            ]
            for group in (self._before, self._after)
        )
        return LinkModel((*before, *static(), *after))

    def users_rules(self) -> Iterator[tuple[str, str, Link]]:
        """Yield each user's rule, alone on a new link that it applies to, with the two ends."""
        network, first, last = self._network, self._run.names[0], self._run.names[-1]
        bases = zip((network, network.sample, network.actuation), _BASE, strict=True)
        tables: list[tuple[LinkTable, Kind, str, str]] = [(t, of, "*", "*") for t, of in bases]
        faults = [fault for fault in self._faults if isinstance(fault, LinkFault)]
        for some in (network.links, faults):
            tables += [(t, t.of, t.sender, t.receiver) for t in some]
        for table, of, sender, receiver in tables:
            if sender == "*":
                sender = first if of == "broadcast" or receiver == "*" else receiver
            if receiver == "*":
                receiver = last if of == "broadcast" else sender
            for stage in _stages(table, 0):
                if not is_built_in(stage.rule):
                    model = LinkModel((stage,))
                    yield sender, receiver, Link(self._run.seeds, sender, receiver, model, of)

    def lies(self, name: str) -> Lies:
        """Return the declared lies of an agent."""
        numbered = enumerate(self._faults, self._first_fault)
        lies = {number: fault for number, fault in numbered if isinstance(fault, LieFault)}
        return Lies(self._run.seeds, name, lies)

    @cached_property
    def occurrences(self) -> tuple[Occurrence, ...]:
        """All occurrences of faults of agents, in the order of the faults."""
        return tuple(
            Occurrence(fault, place, self._first_fault + place, name, t, fault.until(t))
            for place, fault in enumerate(self._faults)
            if isinstance(fault, AgentFault)
            for t, name in fault.times(self._run, place)
        )


def _field(place: int, rule: Rule) -> str:
    """Return the name of a fault's rule, by which its draws are keyed."""
    own = rule.field if isinstance(rule, During) else ""
    return f"faults.{place}.{own}" if own else f"faults.{place}"


def _stages(table: LinkTable, first: int) -> tuple[Stage, ...]:
    """Build a table's rules, with their numbers."""
    return tuple(Stage(*rule, first + n) for n, rule in enumerate(table.fields()))
