"""Faults of clocks: an agent's clock is perturbed, and wrong while a fault lasts."""

import math
from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Literal, NamedTuple, Self

from pydantic import Field, model_validator

from phalanx.faults.fault import AgentFault, Occurrence
from phalanx.schema.fields import Finite, Positive, misplaced
from phalanx.seeded.clock import SamplingClock


class ClockFault(AgentFault):
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

    def until(self, t: float) -> float:
        """When it is over if it begins at t [s]."""
        return math.inf if self.lasts is None else t + self.lasts


class _Jump(NamedTuple):
    t: float
    """[s]"""
    by: float
    """Delay of all samples from then on [s]."""
    fault: int


class AgentClock:
    """When one agent samples: a pure function of its last sample."""

    def __init__(
        self, clock: SamplingClock, least: float, occurrences: Iterable[Occurrence] = ()
    ) -> None:
        """Go as a clock does, but for faults.

        Args:
            clock: without faults.
            least: between two samples [s], whatever the clock says.
            occurrences: of faults of this agent; only those of clocks count.
        """
        self.faults: Counter[int] = Counter()
        """Samples that each declared fault put off, or brought forward."""
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

    def after(self, k: int, t: float) -> float:
        """When its tick after tick k is, which was at t [s]."""
        due = right = self._clock.after(k, t)
        for drift, occurrence in self._drifts:
            if occurrence.holds(t):
                due += drift * (right - t)
                self.faults[occurrence.number] += 1
        for jump in self._jumps:
            if t <= jump.t < due:
                due = max(math.nextafter(jump.t, math.inf), due + jump.by)
                self.faults[jump.fault] += 1
        return due if due == right else max(due, math.nextafter(t + self._least, math.inf))
