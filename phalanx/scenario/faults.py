"""The [[faults]] list, and what goes wrong on links for a time."""

from typing import Annotated, Literal, Self, get_args

from pydantic import Field, model_validator

from phalanx.network.partition import Shape, between, shaped
from phalanx.scenario.agent_faults import AgentFault
from phalanx.scenario.fields import Name, misplaced
from phalanx.scenario.lies import LieFault
from phalanx.scenario.network import LinkTable, SomeLinks, require_in_time
from phalanx.scenario.timed import Timed
from phalanx.seeded.draws import Draws


class Partition(Timed):
    """Links between groups of agents carry nothing."""

    kind: Literal["partition"]
    groups: tuple[tuple[Name, ...], ...] = ()
    """Who is together; all that are in none make a group of their own."""
    shape: Shape | None = None
    """Instead of groups: who is together is drawn at random."""
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

    def check(self, names: list[str], where: tuple[str | int, ...]) -> None:
        """Raise ValidationError for a name that nobody has, or if nobody is apart."""
        for group in self.groups:
            for name in group:
                if name not in names:
                    message = f"expected agents' names, of {names}"
                    raise misplaced((*where, "groups"), message, name)
        if len(self._complete(names)) < 2 and not self.shape:
            raise misplaced(
                (*where, "groups"), "expected two groups, or somebody in none", self.groups
            )

    def cut(self, names: list[str], seed: int, place: int) -> frozenset[tuple[str, str]]:
        """The links (sender, receiver) that carry nothing, if this is fault number `place`."""
        if self.shape:
            return shaped(self.shape, names, Draws(seed, "partition", str(place)))
        return between(self._complete(names), self.one_way)

    def _complete(self, names: list[str]) -> list[tuple[str, ...]]:
        members = {name for group in self.groups for name in group}
        rest = tuple(name for name in names if name not in members)
        return [*self.groups, rest] if rest else list(self.groups)


class HoldFault(Timed, SomeLinks):
    """Links keep what they carry, and deliver all of it at once when it is over."""

    kind: Literal["hold"]

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            raise misplaced(
                ("of",), "expected broadcast or actuation: samples are not late", self.of
            )
        return self


class LinkFault(Timed, SomeLinks, LinkTable):
    """Fields of a link model that act before those of [network], for what is sent meanwhile."""

    kind: Literal["link"]

    @model_validator(mode="after")
    def _in_time(self) -> Self:
        if self.of == "sample":
            require_in_time(self, ())
        return self


Fault = Annotated[
    Partition | HoldFault | LinkFault | LieFault | AgentFault, Field(discriminator="kind")
]
KINDS = frozenset(
    kind
    for model in get_args(get_args(Fault)[0])
    for kind in get_args(model.model_fields["kind"].annotation)
)
"""Of every fault that a scenario may declare."""
