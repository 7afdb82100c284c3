"""Faults of links for a time: partitions, links that hold what they carry, worse link models."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from pydantic import model_validator

from phalanx.faults.fault import AgentFacts, LinkRules, RunFacts, TimedFault, Where
from phalanx.network.rule import Cut, Message, Treatment, delay
from phalanx.network.table import LinkTable, SomeLinks, require_in_time
from phalanx.schema.fields import Name, misplaced
from phalanx.seeded.draws import Draws

Shape = Literal["majority", "ring", "isolate"]
"""Jepsen's."""
Ends = tuple[str, str]
"""Sender and receiver."""


class Partition(TimedFault):
    """Links between groups of agents carry nothing."""

    kind: Literal["partition"]
    groups: tuple[tuple[Name, ...], ...] = ()
    """Agents that are together; all that are in none make a group of their own."""
    shape: Shape | None = None
    """Instead of groups: those that are together are drawn at random."""
    one_way: bool = False
    """Only what leaves the first group is lost."""

    @model_validator(mode="after")
    def _groups_or_shape(self) -> Self:
        if bool(self.groups) == bool(self.shape):
            raise ValueError("expected groups, or a shape")
        members = [name for group in self.groups for name in group]
        for name in members:
            if members.count(name) > 1:
                raise misplaced(("groups",), f"expected {name!r} in one group", members)
        if self.shape and self.one_way:
            raise misplaced(("one_way",), "expected groups, of which the first is meant", True)
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: Where) -> None:
        """Raise ValidationError for a name that nobody has, or if nobody is apart."""
        for name in itertools.chain(*self.groups):
            if name not in agents:
                raise misplaced((*where, "groups"), f"expected agents' names, of {[*agents]}", name)
        if len(self._complete(tuple(agents))) < 2 and not self.shape:
            raise misplaced(
                (*where, "groups"), "expected two groups, or somebody in none", self.groups
            )

    def on_links(self, run: RunFacts, place: int) -> LinkRules:
        """Nothing comes through links between the groups."""
        if self.shape:
            cut = shaped(self.shape, run.names, Draws(run.seed, "partition", str(place)))
        else:
            cut = between(self._complete(run.names), self.one_way)
        dropped = (self.during(Cut()),)
        return lambda link: dropped if link.of == "broadcast" and link[:2] in cut else ()

    def _complete(self, names: tuple[str, ...]) -> list[tuple[str, ...]]:
        members = set(itertools.chain(*self.groups))
        rest = tuple(name for name in names if name not in members)
        return [*self.groups, rest] if rest else list(self.groups)


class _FaultOfSomeLinks(TimedFault, SomeLinks):
    def check(self, agents: Mapping[str, AgentFacts], where: Where) -> None:
        """Raise ValidationError for a name that nobody has."""
        self.check_names(list(agents), where)


class HoldFault(_FaultOfSomeLinks):
    """Links keep what they carry, and deliver all of it at once when it is over."""

    kind: Literal["hold"]
    order: ClassVar[int] = 1

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            raise misplaced(
                ("of",), "expected broadcast or actuation: samples are not late", self.of
            )
        return self

    def on_links(self, run: RunFacts, place: int) -> LinkRules:
        """Whatever would arrive before the end arrives then."""
        held = (self.during(Hold(self.end)),)
        return lambda link: held if self.concerns(*link) else ()


class LinkFault(_FaultOfSomeLinks, LinkTable):
    """Fields of a link model that act before those of [network], for what is sent meanwhile."""

    kind: Literal["link"]

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            require_in_time(self, ())
        return self

    def on_links(self, run: RunFacts, place: int) -> LinkRules:
        """The table's, built anew for each link: a user's may keep what they were asked."""
        return lambda link: (
            [self.during(rule) for _, rule in self.fields()] if self.concerns(*link) else ()
        )


@dataclass(frozen=True)
class Hold:
    """Whatever would arrive before a time arrives at that time: a full socket, then a flood."""

    until: float
    """[s]"""

    def treat(self, message: Message) -> Treatment:
        """Delay to the release."""
        return delay(max(0.0, self.until - message.t))


def between(groups: Sequence[Sequence[str]], one_way: bool = False) -> frozenset[Ends]:
    """Links between different groups; one way: only those out of the first group."""
    return frozenset(
        (sender, receiver)
        for place, (a, b) in enumerate(itertools.permutations(groups, 2))
        if not one_way or place < len(groups) - 1
        for sender in a
        for receiver in b
    )


def shaped(shape: Shape, names: Sequence[str], draws: Draws) -> frozenset[Ends]:
    """The links that a shape cuts, its agents drawn at random.

    majority: two halves, the first larger by one or two. ring: everybody hears a majority, and no
    two the same one. isolate: one agent alone.
    """
    order = sorted(names, key=lambda name: float(draws[names.index(name)][0]))
    majority = len(order) // 2 + 1
    if shape == "majority":
        return between([order[:majority], order[majority:]])
    if shape == "isolate":
        return between([order[:1], order[1:]])
    heard = {
        (order[(place + ahead) % len(order)], receiver)
        for place, receiver in enumerate(order)
        for ahead in range(majority)
    }
    return frozenset(link for link in itertools.permutations(order, 2) if link not in heard)


OfLinks = Partition | HoldFault | LinkFault
