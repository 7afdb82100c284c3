"""What goes wrong with agents, in [[faults]]: processes, clocks, sensors and actuators."""

from collections.abc import Iterator, Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from phalanx.faults.commands import CommandKind
from phalanx.faults.strikes import MOST, Strike, at_random
from phalanx.network.link import Kind
from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.fields import Finite, Name, NonNegative, Positive, Strict, misplaced
from phalanx.seeded.draws import Draws

Where = tuple[str | int, ...]


class OfAgents(Strict):
    """Agents that are struck: once each at a time, or one at a time at random."""

    at: NonNegative | None = None
    """When all of them are struck [s]."""
    rate: Annotated[Positive, Field(le=MOST)] | None = None
    """Instead: how often one of them is, drawn each time [1/s]."""
    agents: tuple[Name, ...] = ()
    """Who; by default everybody."""

    @model_validator(mode="after")
    def _at_or_rate(self) -> Self:
        if (self.at is None) == (self.rate is None):
            raise ValueError("expected at, or a rate")
        return self

    def check_agents(self, groups: Mapping[str, AgentGroup], where: Where) -> None:
        """Raise ValidationError for a name that nobody has. groups: by agent's name."""
        for name in self.agents:
            if name not in groups:
                message = f"expected agents' names, of {list(groups)}"
                raise misplaced((*where, "agents"), message, name)

    def strikes(self, names: list[str], duration: float, draws: Draws) -> Iterator[Strike]:
        """Who of all these is struck in a run of so long [s], and when. draws: of width 2."""
        who = self.agents or tuple(names)
        times = (
            at_random(self.rate, who, duration, draws)
            if self.rate is not None
            else ((self.at or 0.0, name) for name in who)
        )
        for t, name in times:
            yield self.strike(t, name)

    def strike(self, t: float, name: str) -> Strike:
        """One agent, struck at t [s]."""
        return Strike(name, t)

    def commands(self, strike: Strike) -> tuple[tuple[float, CommandKind], ...]:
        """What a person would command at which times [s], to have it happen."""
        return ()

    @property
    def cuts(self) -> Kind | None:
        """Which of a robot's own links carries nothing meanwhile, if one does."""
        return None


class ForATime(OfAgents):
    """Agents that are struck for a time."""

    lasts: Positive = Field(alias="for")
    """For how long [s]."""

    def strike(self, t: float, name: str) -> Strike:
        """One agent, struck at t [s]."""
        return Strike(name, t, t + self.lasts)


class KillFault(OfAgents):
    """Processes die by kill -9."""

    kind: Literal["kill"]

    def commands(self, strike: Strike) -> tuple[tuple[float, CommandKind], ...]:
        """Kill."""
        return ((strike.begin, CommandKind.KILL),)


class RestartFault(ForATime):
    """Processes die by kill -9, and others take their places, later and with nothing received."""

    kind: Literal["restart"]

    def commands(self, strike: Strike) -> tuple[tuple[float, CommandKind], ...]:
        """Kill, restart."""
        return ((strike.begin, CommandKind.KILL), (strike.end, CommandKind.RESTART))


class PauseFault(ForATime):
    """Processes stand still: they neither sample, answer nor hear."""

    kind: Literal["pause"]

    def commands(self, strike: Strike) -> tuple[tuple[float, CommandKind], ...]:
        """Freeze, thaw."""
        return ((strike.begin, CommandKind.FREEZE), (strike.end, CommandKind.THAW))


class TurnFault(OfAgents):
    """Normal agents become adversaries, and stay that."""

    kind: Literal["turn"]

    def check_agents(self, groups: Mapping[str, AgentGroup], where: Where) -> None:
        """Raise ValidationError for whoever is no normal agent."""
        super().check_agents(groups, where)
        for name in self.agents or groups:
            if groups[name].role == "adversary":
                raise misplaced((*where, "agents"), "expected normal agents", name)

    def commands(self, strike: Strike) -> tuple[tuple[float, CommandKind], ...]:
        """Turn."""
        return ((strike.begin, CommandKind.TURN),)


class ClockFault(OfAgents):
    """Clocks are wrong: they sample too late or too early."""

    kind: Literal["clock"]
    step: Finite | None = None
    """The clock is set back, for good: samples come so much later [s]; negative: sooner, at once at
    the soonest."""
    skew: Finite | None = None
    """The same, until the fault is over [s]."""
    drift: Annotated[Finite, Field(gt=-0.5, le=10.0)] | None = None
    """Meanwhile the time from one sample to the next is so much longer, as a share."""
    lasts: Positive | None = Field(default=None, alias="for")
    """For how long [s]."""

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if [self.step, self.skew, self.drift].count(None) != 2:
            raise ValueError("expected one of step, skew and drift")
        if (self.lasts is None) != (self.step is not None):
            raise misplaced(("for",), "expected with skew and drift alone", self.lasts)
        return self

    def strike(self, t: float, name: str) -> Strike:
        """One agent, struck at t [s]."""
        return Strike(name, t) if self.lasts is None else Strike(name, t, t + self.lasts)


class SensorFault(ForATime):
    """Sensors bring no samples, or are wrong about their own robot's state."""

    kind: Literal["sensor"]
    silent: bool = False
    bias: dict[str, Finite] = Field(default_factory=dict)
    """What is added to states, by name: { px = 0.5 } [SI]."""
    noise: dict[str, NonNegative] = Field(default_factory=dict)
    """Standard deviation of what is added to states at each sample, by name [SI]."""

    @model_validator(mode="after")
    def _wrong_or_silent(self) -> Self:
        if self.silent == bool(self.bias or self.noise):
            raise ValueError("expected silent = true, or bias and noise")
        return self

    def check_agents(self, groups: Mapping[str, AgentGroup], where: Where) -> None:
        """Raise ValidationError for a state that one of the agents does not have."""
        super().check_agents(groups, where)
        for name in self.agents or groups:
            states = groups[name].dynamics_object().states
            for field, table in (("bias", self.bias), ("noise", self.noise)):
                for state in table.keys() - set(states):
                    message = f"expected states of agent {name}, of {list(states)}"
                    raise misplaced((*where, field), message, state)

    @property
    def cuts(self) -> Kind | None:
        """The link from its sensors."""
        return "sample" if self.silent else None


class ActuatorFault(ForATime):
    """Actuators are stuck: they hold the input that they have."""

    kind: Literal["actuator"]

    @property
    def cuts(self) -> Kind | None:
        """The link to its actuators."""
        return "actuation"


AgentFault = (
    KillFault | RestartFault | PauseFault | TurnFault | ClockFault | SensorFault | ActuatorFault
)
