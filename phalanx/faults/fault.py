"""The protocol of [[faults]]: one fault is its table, and its effects on links and agents.

A family of faults is one file. To add a fault, write its table there, a Fault with a `kind` of its
own, and enter it in that file's union. The rest follows: what links, agents and clocks make of it
is asked of its methods, and what it does is counted under its number.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, NamedTuple, Self

from pydantic import Field, model_validator

from phalanx.faults.commands import CommandKind
from phalanx.network.link import Kind
from phalanx.network.rule import During, Rule
from phalanx.schema.fields import Name, NonNegative, Positive, Strict, misplaced
from phalanx.seeded.draws import Draws

Where = tuple[str | int, ...]
"""A place in the scenario, for the message of an error."""

_GRAIN = 1e-3
"""Occurrences at random begin at multiples of it [s]."""
_HIGHEST_RATE = 0.1 / _GRAIN
"""[1/s]: one occurrence in a grain has to be as good as any number of them."""


class AgentFacts(NamedTuple):
    """One agent, as far as faults ask."""

    adversary: bool
    states: tuple[str, ...]
    inputs: tuple[str, ...]


class RunFacts(NamedTuple):
    """A run, as far as faults ask."""

    names: tuple[str, ...]
    """Of all agents, in the scenario's order."""
    duration: float
    """[s]"""
    seed: int


class LinkEnds(NamedTuple):
    """A link. Both ends of a robot's own, of samples and actuations, are called like it."""

    sender: str
    receiver: str
    of: Kind = "broadcast"


LinkRules = Callable[[LinkEnds], Iterable[Rule]]
"""The rules that a fault adds to a link."""


class Occurrence(NamedTuple):
    """A fault of one agent, once."""

    fault: "AgentFault"
    place: int
    """Of the fault in the scenario's list."""
    number: int
    """Of the fault among all that the scenario declares."""
    agent: str
    begin: float
    """[s]"""
    end: float
    """[s]; no longer in force at this instant."""

    def holds(self, t: float) -> bool:
        """Whether it is in force at t [s]."""
        return self.begin <= t < self.end


class Fault(Strict):
    """An entry of [[faults]]."""

    kind: str
    order: ClassVar[int] = -1
    """When its rules act on a message: those of [network] do at 0."""

    def check(self, agents: Mapping[str, AgentFacts], where: Where) -> None:
        """Raise ValidationError unless it fits the scenario's agents, by name."""

    def on_links(self, run: RunFacts, place: int) -> LinkRules:
        """Its effect on the links of a run, as entry number `place` of the list."""
        return lambda link: ()


class TimedFault(Fault):
    """A fault from one time to another."""

    at: NonNegative = 0.0
    """From when on [s]."""
    lasts: Positive = Field(alias="for")
    """For how long [s]."""

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.at + self.lasts

    def during(self, rule: Rule) -> Rule:
        """The rule, in force in this fault's time."""
        return During(self.at, self.end, rule)


class AgentFault(Fault):
    """A fault of agents: of all of them once at a time, or of one at a time at random."""

    at: NonNegative | None = None
    """When it happens to all of them [s]."""
    rate: Annotated[Positive, Field(le=_HIGHEST_RATE)] | None = None
    """Instead: how often it happens to one of them, drawn each time [1/s]."""
    agents: tuple[Name, ...] = ()
    """Their names; by default everybody's."""

    begins_with: ClassVar[CommandKind | None] = None
    """The command that a person would give to have it happen, if there is one."""
    ends_with: ClassVar[CommandKind | None] = None
    """The same for its end."""

    @model_validator(mode="after")
    def _at_or_rate(self) -> Self:
        if (self.at is None) == (self.rate is None):
            raise ValueError("expected at, or a rate")
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: Where) -> None:
        """Raise ValidationError for a name that nobody has."""
        for name in self.agents:
            if name not in agents:
                raise misplaced((*where, "agents"), f"expected agents' names, of {[*agents]}", name)

    def until(self, t: float) -> float:
        """When it is over if it begins at t [s]."""
        return math.inf

    def times(self, run: RunFacts, place: int) -> Iterator[tuple[float, str]]:
        """The times of its occurrences [s], each with the agent's name."""
        agents = self.agents or run.names
        if self.rate is None:
            return ((self.at or 0.0, name) for name in agents)
        draws = Draws(run.seed, "fault", str(place), width=2)
        return at_random(self.rate, agents, run.duration, draws)


class AgentFaultForATime(AgentFault):
    """A fault of agents that is over after a time."""

    lasts: Positive = Field(alias="for")
    """For how long [s]."""

    def until(self, t: float) -> float:
        """When it is over if it begins at t [s]."""
        return t + self.lasts


def at_random(
    rate: float, agents: Sequence[str], duration: float, draws: Draws
) -> Iterator[tuple[float, str]]:
    """Times up to `duration` [s], `rate` of them in a second on average, each with one agent.

    draws: of width 2. Compared alone, never put through a logarithm: the same times on every CPU.
    """
    for n in range(math.ceil(duration / _GRAIN)):
        happens, which = draws[n].tolist()
        if happens < rate * _GRAIN:
            yield n * _GRAIN, agents[int(which * len(agents))]
