"""Clock faults: steps, skew and drift of an agent's perturbed clock."""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from phalanx.faults.fault import AgentFault, Occurrence
from phalanx.schema.fields import Finite, Positive, field_error
from phalanx.seeded.draws import SamplingClock


class ClockFault(AgentFault):
    """Clocks trigger samples too late or too early."""

    kind: Literal["clock"]
    step: Finite | None = None
    """Permanent delay of all later samples [s]; negative: earlier, at most by the time left to
    the next one."""
    skew: Finite | None = None
    """The same for the fault's duration [s]."""
    drift: Annotated[Finite, Field(gt=-0.5, le=10.0)] | None = None
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
        for each in occurrences:
            if not isinstance(fault := each.fault, ClockFault):
                continue
            if fault.drift is not None:
                self._drifts.append((fault.drift, each))
            elif fault.step is not None:
                jumps.append(_Jump(each.begin, fault.step, each.number))
            elif fault.skew is not None:
                jumps.append(_Jump(each.begin, fault.skew, each.number))
                jumps.append(_Jump(each.end, -fault.skew, each.number))
        self._jumps = sorted(jumps)

    def after(self, k: int, t: float, now: float = 0.0) -> float:
        """Return the time of tick k + 1 [s], given that tick k was at t [s]; decided now [s]."""
        due = right = self._clock.after(k, t, now)
        for drift, occurrence in self._drifts:
            if occurrence.in_force(t):
                due += drift * (right - t)
                self.faults[occurrence.number] += 1
        for jump in self._jumps:
            if t <= jump.t < due:
                due = max(math.nextafter(jump.t, math.inf), due + jump.by)
                self.faults[jump.fault] += 1
        return due if due == right else max(due, math.nextafter(t + self._least, math.inf))
