"""An agent's clock as it really goes: perturbed, and wrong while a fault lasts."""

import math
from collections import Counter
from typing import NamedTuple

from phalanx.faults.strikes import Strike
from phalanx.scenario.agent_faults import ClockFault
from phalanx.swarm.swarm import Swarm


class _Jump(NamedTuple):
    t: float
    """[s]"""
    by: float
    """How much later samples come from then on [s]."""
    fault: int


class _Drift(NamedTuple):
    share: float
    """How much longer the time from one sample to the next is, as a share."""
    strike: Strike
    fault: int


class AgentClock:
    """When one agent samples: a pure function of its last sample."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        self.faults: Counter[int] = Counter()
        """Samples that each declared fault put off, or brought forward."""
        self._clock = swarm.clock(i)
        # Its input is due before the next sample, whatever the clock says.
        self._least = swarm.scenario.time.latency
        self._jumps: list[_Jump] = []
        self._drifts: list[_Drift] = []
        for place, fault, strike in swarm.struck:
            if isinstance(fault, ClockFault) and strike.agent == swarm.names[i]:
                self._add(fault, strike, swarm.links.number(place))
        self._jumps.sort()

    def _add(self, fault: ClockFault, strike: Strike, number: int) -> None:
        if fault.drift is not None:
            self._drifts.append(_Drift(fault.drift, strike, number))
        elif fault.step is not None:
            self._jumps.append(_Jump(strike.begin, fault.step, number))
        elif fault.skew is not None:
            self._jumps.append(_Jump(strike.begin, fault.skew, number))
            self._jumps.append(_Jump(strike.end, -fault.skew, number))

    def after(self, k: int, t: float) -> float:
        """When its tick after tick k is, which was at t [s]."""
        due = right = self._clock.after(k, t)
        for drift in self._drifts:
            if drift.strike.holds(t):
                due += drift.share * (right - t)
                self.faults[drift.fault] += 1
        for jump in self._jumps:
            if t <= jump.t < due:
                due = max(math.nextafter(jump.t, math.inf), due + jump.by)
                self.faults[jump.fault] += 1
        return due if due == right else max(due, math.nextafter(t + self._least, math.inf))
