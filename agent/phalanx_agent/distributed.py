"""The distributed controller: an agent's own law, row and QP, as in (QPdistributed)."""

from collections.abc import Mapping
from typing import Self

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.laws.attacks import WorstCase
from phalanx.theory.laws.law import NominalInput, View
from phalanx.theory.rows.information import ReceivedInput
from phalanx.theory.rows.safety_filter import Situation
from phalanx_agent.controller import StepResult


class DistributedController:
    """One agent's controller, normal or adversary, which asks nobody."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        """Compile agent i's own copy of the theory."""
        swarm = rows.swarm
        self._rows, self._i = rows, i
        self._members, self._parts = swarm.members, swarm.safe_set.parts
        self._nominal = NominalInput(swarm.law(i), swarm.members[i])
        self._goal = swarm.goal(i)
        self._terms = rows.terms(i)
        self._filter = rows.filter(i)
        self._latency = swarm.scenario.time.latency

    def __call__(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s]: NaN but of those seen."""
        i, terms = self._i, self._terms(x, seen)
        states = {l: x[self._parts[l]] for l in seen}
        goal = self._goal(t, states[i])
        normal = [l for l in seen if not self._members[l].adversary]
        u_nom = self._nominal(View(i, states, normal, goal, terms))
        now = Situation(t + self._latency, x, seen, terms, u_nom, received)
        decision, used = self._filter(now)
        return StepResult(decision, u_nom, used)

    def turned(self) -> Self:
        """It attacks from now on, and keeps no row."""
        self._nominal = NominalInput(WorstCase(), self._members[self._i])
        self._filter = self._rows.unfiltered(self._i)
        return self
