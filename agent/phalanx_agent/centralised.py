"""The centralised controller of Theorem 1: (QPmultiple), solved once for all normal agents."""

from collections.abc import Mapping

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.laws.law import NominalInput, View
from phalanx.theory.rows.centralised import JointInput
from phalanx.theory.rows.information import ReceivedInput
from phalanx_agent.controller import StepResult
from phalanx_agent.distributed import DistributedController


class CentralisedController:
    """What all normal agents do at one sampled state."""

    def __init__(self, rows: SafetyRows) -> None:
        """Compile the theory once for all."""
        swarm = rows.swarm
        first = swarm.normal[0]
        self.rows, self._normal = rows, swarm.normal
        self._authority = swarm.scenario.safety.authority
        self._nominal = [NominalInput(swarm.law(l), swarm.members[l]) for l in self._normal]
        self._goals = [swarm.goal(l) for l in self._normal]
        self._parts = swarm.safe_set.parts
        self._terms = rows.terms(first)
        self._qp = JointInput([swarm.members[l].dynamics for l in self._normal])
        self._sampled: tuple[float, bytes] | None = None
        self._results: dict[int, StepResult] = {}

    def at(self, x: Array, t: float) -> dict[int, StepResult]:
        """Every normal agent's input for the state x, shape (n̄,), sampled at t [s].

        Agents that sample together share one solution; those that do not, as Theorem 1 would
        have it, get one each.
        """
        sampled = t, x.tobytes()
        if sampled != self._sampled:
            self._sampled, self._results = sampled, self._decide(x, t)
        return self._results

    def _decide(self, x: Array, t: float) -> dict[int, StepResult]:
        terms, normal = self._terms(x), self._normal
        states = {l: x[part] for l, part in enumerate(self._parts)}
        u_nom = [
            nominal(View(l, states, normal, goal(t, states[l]), terms))
            for l, nominal, goal in zip(normal, self._nominal, self._goals, strict=True)
        ]
        decisions = self._qp.decide(terms, normal, u_nom, self._authority)
        return {
            l: StepResult(decision, nominal, [])
            for l, decision, nominal in zip(normal, decisions, u_nom, strict=True)
        }


class CentralisedPart:
    """One agent's part of the centralised controller."""

    def __init__(self, whole: CentralisedController, i: int) -> None:
        self._whole, self._i = whole, i

    def __call__(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s]; the controller sees all."""
        return self._whole.at(x, t)[self._i]

    def turned(self) -> DistributedController:
        """It leaves the controller, which goes on counting on it."""
        return DistributedController(self._whole.rows, self._i).turned()
