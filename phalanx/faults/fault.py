"""Base classes of [[faults]]: a fault is its table, and its effects on links and agents.

Each family of faults is one file. To add a fault, write its table there, a Fault with its own
`kind`, and add it to that file's union. Links, agents and clocks call its methods, and its effects
are counted under its number.
"""

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, NamedTuple, Self

from pydantic import Field, model_validator

from phalanx.faults.commands import CommandKind
from phalanx.network.draws import Seeds, Tables
from phalanx.network.link import Kind
from phalanx.network.rule import During, Rule
from phalanx.schema.fields import Name, NonNegative, Positive, Strict, field_error

FieldPath = tuple[str | int, ...]
"""Location of a field in the scenario, for error messages."""

_GRID = 1e-3
"""Random occurrences begin at multiples of it [s]."""
_HIGHEST_RATE = 0.1 / _GRID
"""[1/s]: more than one occurrence per grid step must be so rare that it can be neglected."""


class AgentFacts(NamedTuple):
    """Properties of an agent that faults need."""

    adversary: bool
    states: tuple[str, ...]
    inputs: tuple[str, ...]


class RunFacts(NamedTuple):
    """Properties of a run that faults need."""

    names: tuple[str, ...]
    """All agents, in the scenario's order."""
    duration: float
    """[s]"""
    seeds: Seeds


class LinkEnds(NamedTuple):
    """A link. A link within a robot has the robot's name at both ends."""

    sender: str
    receiver: str
    of: Kind = "broadcast"


LinkRules = Callable[[LinkEnds], Iterable[Rule]]
"""The rules that a fault adds to a link."""


class Occurrence(NamedTuple):
    """One occurrence of a fault at one agent, in force in [begin, end)."""

    fault: "AgentFault"
    fault_index: int
    """Index in the scenario's list of faults."""
    number: int
    """Index in phalanx.scenario.declared.Links.declared."""
    agent: str
    begin: float
    """[s]"""
    end: float
    """[s]"""

    def in_force(self, t: float) -> bool:
        """Return whether it is in force at t [s]."""
        return self.begin <= t < self.end


class Fault(Strict):
    """An entry of [[faults]]."""

    kind: str
    order: ClassVar[int] = -1
    """Position of its rules on a link; those of [network] are at 0."""

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        """Raise ValidationError unless it fits the scenario's agents, by name."""

    def on_links(self, run: RunFacts, index: int) -> LinkRules:
        """Return its effect on the links of a run, as entry number `index` of the list."""
        return lambda link: ()


class TimedFault(Fault):
    """A fault in force from one time to another."""

    at: NonNegative = 0.0
    """Begin [s]."""
    lasts: Positive = Field(alias="for")
    """Duration [s]."""

    @property
    def end(self) -> float:
        """End [s]."""
        return self.at + self.lasts

    def during(self, rule: Rule, field: str = "") -> Rule:
        """Restrict a rule to the time of this fault."""
        return During(self.at, self.end, rule, field)


class AgentFault(Fault):
    """A fault of agents: of all of them at a given time, or of one at each random time."""

    at: NonNegative | None = None
    """Time at which it happens to all of them [s]."""
    rate: Annotated[Positive, Field(le=_HIGHEST_RATE)] | None = None
    """Instead: mean rate of occurrences [1/s], each at an agent drawn from them."""
    agents: tuple[Name, ...] = ()
    """Names; default: all agents."""

    begins_with: ClassVar[CommandKind | None] = None
    """The command with the same effect, if there is one."""
    ends_with: ClassVar[CommandKind | None] = None
    """The command with the same effect as its end."""

    @model_validator(mode="after")
    def _at_or_rate(self) -> Self:
        if (self.at is None) == (self.rate is None):
            raise ValueError("expected at, or a rate")
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        require_names(self.agents, agents, (*where, "agents"))

    def until(self, t: float) -> float:
        """Return the end of an occurrence that begins at t [s]."""
        return math.inf

    def times(self, run: RunFacts, index: int) -> Iterator[tuple[float, str]]:
        """Return the times of its occurrences [s], each with the agent's name."""
        agents = self.agents or run.names
        if self.rate is None:
            return ((self.at or 0.0, name) for name in agents)
        tables = Tables(run.seeds, "fault", str(index), width=2)
        return random_times(self.rate, agents, run.duration, tables)


class TemporaryAgentFault(AgentFault):
    """A fault of agents with a duration."""

    lasts: Positive = Field(alias="for")
    """Duration [s]."""

    def until(self, t: float) -> float:
        return t + self.lasts


def require_names(names: Iterable[str], allowed: Collection[str], where: FieldPath) -> None:
    """Raise ValidationError for a name that is not known."""
    for name in names:
        if name not in allowed:
            raise field_error(where, f"expected an agent's name, one of {[*allowed]}", name)


def random_times(
    rate: float, agents: Sequence[str], duration: float, tables: Tables
) -> Iterator[tuple[float, str]]:
    """Yield times up to `duration` [s], `rate` per second on average, each with one agent.

    tables: of width 2. Draws are only compared, never put through a logarithm, so that times are
    the same on every CPU.
    """
    for n in range(math.ceil(duration / _GRID)):
        happens, choice = tables.decide(n, n * _GRID)()[n].tolist()
        if happens < rate * _GRID:
            yield n * _GRID, agents[int(choice * len(agents))]
