"""Temporary link faults: partitions, links that hold messages back, worse link models."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from phalanx.faults.fault import (
    AgentFacts,
    FieldPath,
    LinkRules,
    RunFacts,
    TimedFault,
    require_names,
)
from phalanx.network.draws import Draws
from phalanx.network.rule import DELIVER, Cut, Message, Treatment, delay
from phalanx.network.table import LinkOverride, SomeLinks
from phalanx.schema.fields import Name, field_error

Shape = Literal["majority", "ring", "isolate"]
"""Names as in Jepsen."""
Ends = tuple[str, str]
"""Sender and receiver."""


class Partition(TimedFault):
    """Links between groups of agents carry nothing."""

    kind: Literal["partition"]
    groups: tuple[tuple[Name, ...], ...] = ()
    """Agents that stay connected; all agents in no group form one more group."""
    shape: Shape | None = None
    """Instead of groups: agents that stay connected are drawn at random."""

    @model_validator(mode="after")
    def _groups_or_shape(self) -> Self:
        if bool(self.groups) == bool(self.shape):
            raise ValueError("expected groups, or a shape")
        members = [name for group in self.groups for name in group]
        for name in members:
            if members.count(name) > 1:
                raise field_error(("groups",), f"expected {name!r} in one group", members)
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        """Raise ValidationError for an unknown name, or if all agents stay connected."""
        field = (*where, "groups")
        require_names(itertools.chain(*self.groups), agents, field)
        if len(self._complete(tuple(agents))) < 2 and not self.shape:
            raise field_error(field, "expected two groups, or an agent in no group", self.groups)
        # Of two agents both are a majority.
        least = 2 if self.shape == "isolate" else 3
        if self.shape and len(agents) < least:
            raise field_error(
                (*where, "shape"), f"expected {least} agents or more to part", self.shape
            )

    def on_links(self, run: RunFacts, index: int) -> LinkRules:
        """Cut the links between the groups."""
        if self.shape:
            draws = Draws(run.seeds.at(self.at), "partition", str(index))
            cut = links_cut(self.shape, run.names, draws)
        else:
            cut = links_between(self._complete(run.names))
        dropped = (self.during(Cut()),)
        return lambda link: dropped if link.of == "broadcast" and link[:2] in cut else ()

    def _complete(self, names: tuple[str, ...]) -> list[tuple[str, ...]]:
        members = set(itertools.chain(*self.groups))
        rest = tuple(name for name in names if name not in members)
        return [*self.groups, rest] if rest else list(self.groups)


class _FaultOfSomeLinks(TimedFault, SomeLinks):
    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        self.check_names(list(agents), where)


class HoldFault(_FaultOfSomeLinks):
    """Links hold messages back, and deliver all of them at once at the end of the fault."""

    kind: Literal["hold"]
    order: ClassVar[int] = 1

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            message = "expected broadcast or actuation: samples cannot be delayed"
            raise field_error(("of",), message, self.of)
        return self

    def on_links(self, run: RunFacts, index: int) -> LinkRules:
        """Delay every message that would arrive before the end until the end."""
        hold = (Hold(self.at, self.end),)
        return lambda link: hold if self.concerns(*link) else ()


class LinkFault(_FaultOfSomeLinks, LinkOverride):
    """A link model that acts before that of [network], on messages sent during the fault."""

    kind: Literal["link"]

    def on_links(self, run: RunFacts, index: int) -> LinkRules:
        """Build the table's rules for each link: a user's rules may have a state."""
        return lambda link: (
            [self.during(rule, field if "." in field else "") for field, rule in self.fields()]
            if self.concerns(*link)
            else ()
        )


@dataclass(frozen=True)
class Hold:
    """Messages that would arrive in [begin, end) arrive at its end, as from a blocked socket."""

    begin: float
    """[s]"""
    end: float
    """[s]"""

    def treat(self, message: Message) -> Treatment:
        in_time = self.begin <= message.t < self.end
        return delay(self.end - message.t) if in_time else DELIVER


def links_between(groups: Sequence[Sequence[str]]) -> frozenset[Ends]:
    """Return the links between different groups."""
    return frozenset(
        (sender, receiver)
        for a, b in itertools.permutations(groups, 2)
        for sender in a
        for receiver in b
    )


def links_cut(shape: Shape, names: Sequence[str], draws: Draws) -> frozenset[Ends]:
    """Return the links that a shape cuts, its agents drawn at random.

    majority: two halves, the first larger by one or two. ring: every agent receives from a
    majority, and no two from the same one. isolate: one agent alone.
    """
    order = sorted(names, key=lambda name: float(draws[names.index(name)][0]))
    majority = len(order) // 2 + 1
    if shape == "majority":
        return links_between([order[:majority], order[majority:]])
    if shape == "isolate":
        return links_between([order[:1], order[1:]])
    heard = {
        (order[(k + ahead) % len(order)], receiver)
        for k, receiver in enumerate(order)
        for ahead in range(majority)
    }
    return frozenset(link for link in itertools.permutations(order, 2) if link not in heard)


AnyLinkFault = Partition | HoldFault | LinkFault
