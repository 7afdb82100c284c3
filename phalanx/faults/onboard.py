"""Onboard faults: clocks run wrong, sensors are silent or wrong, actuators are stuck."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from phalanx.faults.fault import (
    AgentFacts,
    AgentFault,
    FieldPath,
    LinkEnds,
    LinkRules,
    Occurrence,
    RunFacts,
    TemporaryAgentFault,
)
from phalanx.network.delay import quantile
from phalanx.network.draws import SamplingClock, Seeds, Tables
from phalanx.network.link import Kind
from phalanx.network.rule import Cut, During
from phalanx.schema.fields import Finite, NonNegative, Positive, field_error
from phalanx.theory.arrays import Array

_LEAST_DRIFT, _MOST_DRIFT = -0.5, 10.0
"""Of one drift, and of the sum of all that are in force."""


class ClockFault(AgentFault):
    """Clocks trigger samples too late or too early."""

    kind: Literal["clock"]
    step: Finite | None = None
    """Permanent delay of all later samples [s]; negative: earlier, at most by the time left to
    the next one."""
    skew: Finite | None = None
    """The same for the fault's duration [s]."""
    drift: Annotated[Finite, Field(gt=_LEAST_DRIFT, le=_MOST_DRIFT)] | None = None
    """Relative lengthening of the time between samples, for the fault's duration."""
    lasts: Positive | None = Field(default=None, alias="for")
    """Duration [s]."""

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if [self.step, self.skew, self.drift].count(None) != 2:
            raise ValueError("expected one of step, skew and drift")
        if (self.lasts is None) != (self.step is not None):
            raise field_error(("for",), "expected with skew and drift alone", self.lasts)
        return self

    def until(self, t: float) -> float:
        return math.inf if self.lasts is None else t + self.lasts


class OnboardFault(TemporaryAgentFault):
    """A fault that may cut one of the links within a robot."""

    order: ClassVar[int] = -2

    @property
    def cuts(self) -> Kind | None:
        """The link that it cuts, if any."""
        return None

    def on_links(self, run: RunFacts, index: int) -> LinkRules:
        """Cut the link during each occurrence of the fault."""
        if self.cuts is None:
            return super().on_links(run, index)
        cuts: defaultdict[LinkEnds, list[During]] = defaultdict(list)
        for t, name in self.times(run, index):
            link_ends = LinkEnds(name, name, self.cuts)
            cuts[link_ends].append(During(t, self.until(t), Cut()))
        return lambda link: cuts.get(link, ())


class SensorFault(OnboardFault):
    """Sensors deliver no samples, or measure their own robot's state with an error."""

    kind: Literal["sensor"]
    silent: bool = False
    bias: dict[str, Finite] = Field(default_factory=dict)
    """Constant errors by state: { px = 0.5 } [SI]."""
    noise: dict[str, NonNegative] = Field(default_factory=dict)
    """Standard deviations of normal errors, drawn at each sample, by state [SI]."""

    @model_validator(mode="after")
    def _wrong_or_silent(self) -> Self:
        if self.silent == bool(self.bias or self.noise):
            raise ValueError("expected silent = true, or bias and noise")
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        """Raise ValidationError for a state that one of the agents does not have."""
        super().check(agents, where)
        for name in self.agents or agents:
            states = agents[name].states
            for field, table in (("bias", self.bias), ("noise", self.noise)):
                for state in table.keys() - set(states):
                    message = f"expected states of agent {name}, of {list(states)}"
                    raise field_error((*where, field), message, state)

    @property
    def cuts(self) -> Kind | None:
        return "sample" if self.silent else None


class ActuatorFault(OnboardFault):
    """Actuators are stuck: they hold the input that they have."""

    kind: Literal["actuator"]

    @property
    def cuts(self) -> Kind | None:
        return "actuation"


class _Jump(NamedTuple):
    t: float
    """[s]"""
    by: float
    """Delay of all samples from then on [s]."""
    fault: int


class AgentClock:
    """One agent's clock with its faults: the next sample is a pure function of the last one."""

    def __init__(
        self, clock: SamplingClock, least: float, occurrences: Iterable[Occurrence] = ()
    ) -> None:
        """Apply faults to a clock.

        Args:
            clock: the clock without faults.
            least: lower bound on the time between two samples [s].
            occurrences: faults of this agent; those not of clocks are ignored.
        """
        self.faults: Counter[int] = Counter()
        """Number of samples that each declared fault moved."""
        self._clock, self._least = clock, least
        self._drifts: list[tuple[float, Occurrence]] = []
        jumps: list[_Jump] = []
        for occurrence in occurrences:
            if not isinstance(fault := occurrence.fault, ClockFault):
                continue
            if fault.drift is not None:
                self._drifts.append((fault.drift, occurrence))
            elif fault.step is not None:
                jumps.append(_Jump(occurrence.begin, fault.step, occurrence.number))
            elif fault.skew is not None:
                jumps.append(_Jump(occurrence.begin, fault.skew, occurrence.number))
                jumps.append(_Jump(occurrence.end, -fault.skew, occurrence.number))
        self._jumps = sorted(jumps)

    def after(self, k: int, t: float, now: float = 0.0) -> float:
        """Return the time of tick k + 1 [s], given that tick k was at t [s]; decided now [s]."""
        right, drift = self._clock.after(k, t, now), 0.0
        for rate, occurrence in self._drifts:
            if occurrence.in_force(t):
                drift += rate
                self.faults[occurrence.number] += 1
        # Occurrences may overlap, and a sum of -1 would stop the time.
        due = right + min(max(drift, _LEAST_DRIFT), _MOST_DRIFT) * (right - t)
        for jump in self._jumps:
            if t <= jump.t < due:
                due = max(math.nextafter(jump.t, math.inf), due + jump.by)
                self.faults[jump.fault] += 1
        return due if due == right else max(due, math.nextafter(t + self._least, math.inf))


class _Error(NamedTuple):
    """The measurement error of one robot's own state in one occurrence of a fault."""

    occurrence: Occurrence
    bias: Array
    noise: Array
    """Standard deviations, shape (n_i,)."""
    tables: Tables

    def at(self, k: int, t: float) -> Array:
        """Return the error of sample k, taken at t [s], shape (n_i,)."""
        errors = [quantile("normal", float(u)) for u in self.tables.decide(k, t)()[k]]
        error: Array = self.bias + self.noise * np.array(errors)
        return error


class Sensors:
    """The sensors of all agents: each measures its own robot's state, with an error if faulty."""

    def __init__(
        self,
        states: Mapping[str, tuple[str, ...]],
        seeds: Seeds | int,
        occurrences: Iterable[Occurrence] = (),
    ) -> None:
        """states: names by agent. occurrences: those not of sensors are ignored."""
        self.faults: Counter[int] = Counter()
        """Number of samples that each declared fault falsified."""
        ends = np.cumsum([len(names) for names in states.values()]).tolist()
        self._parts = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
        self._errors: defaultdict[int, list[_Error]] = defaultdict(list)
        names = list(states)
        for occurrence in occurrences:
            if isinstance(fault := occurrence.fault, SensorFault) and not fault.silent:
                agent_states = states[occurrence.agent]
                bias = np.array([fault.bias.get(state, 0.0) for state in agent_states])
                noise = np.array([fault.noise.get(state, 0.0) for state in agent_states])
                purpose = "fault", str(occurrence.fault_index), "noise", occurrence.agent
                tables = Tables(seeds, *purpose, width=len(agent_states))
                error = _Error(occurrence, bias, noise, tables)
                self._errors[names.index(occurrence.agent)].append(error)

    def measured(self, i: int, k: int, t: float, x: Array) -> Array:
        """Return the stacked state x, shape (n̄,), as measured in agent i's sample k at t [s].

        The object x itself, if agent i's sensors have no error.
        """
        for error in self._errors[i]:
            if error.occurrence.in_force(t):
                x = x.copy()
                x[self._parts[i]] += error.at(k, t)
                self.faults[error.occurrence.number] += 1
        return x


AnyOnboardFault = ClockFault | SensorFault | ActuatorFault
