"""The controller of Theorem 1, for safety.control = "centralised"."""

from collections.abc import Mapping

from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import CheckedInput, View
from phalanx.theory.rows.centralised import JointInput
from phalanx.theory.rows.information import ReceivedInput
from phalanx_agent.controller import AttackingController, StepResult


class CentralisedController:
    """The QP of all normal agents, (QPmultiple), solved once."""

    def __init__(self, rows: SafetyRows) -> None:
        """Compile the theory of all normal agents."""
        swarm = rows.swarm
        first = swarm.normal[0]
        self.rows, self._normal = rows, swarm.normal
        self._nominal = [CheckedInput(swarm.law(l), swarm.members[l]) for l in self._normal]
        self._goals = [swarm.goal(l) for l in self._normal]
        self._parts = swarm.safe_set.parts
        self._terms = rows.terms(first)
        self._qp = JointInput([swarm.members[l].dynamics for l in self._normal])
        self._sampled: tuple[float, bytes] | None = None
        self._results: dict[int, StepResult] = {}

    def part(self, i: int) -> "CentralisedPart":
        """Return agent i's part."""
        return CentralisedPart(self, i)

    def at(self, x: Array, t: float) -> dict[int, StepResult]:
        """Return every normal agent's result for the state x, shape (n̄,), sampled at t [s].

        Agents that sample at the same time, as in Theorem 1, share one solution.
        """
        sampled = t, x.tobytes()
        if sampled != self._sampled:
            self._sampled, self._results = sampled, self._decide(x, t)
        return self._results

    def _decide(self, x: Array, t: float) -> dict[int, StepResult]:
        terms, normal = self._terms(x), self._normal
        states = {l: x[part] for l, part in enumerate(self._parts)}
        u_nom = [
            nominal(View(l, states, normal, goal(t, states), terms, t))
            for l, nominal, goal in zip(normal, self._nominal, self._goals, strict=True)
        ]
        decisions = self._qp.decide(terms, normal, u_nom)
        return {
            l: StepResult(decision, nominal, [])
            for l, decision, nominal in zip(normal, decisions, u_nom, strict=True)
        }


class CentralisedPart:
    """One agent's part of the centralised controller."""

    def __init__(self, whole: CentralisedController, i: int) -> None:
        self._whole, self._i = whole, i

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide, as an AgentController does; the centralised one sees all."""
        return self._whole.at(x, t)[self._i]

    def as_adversary(self) -> AttackingController:
        """Attack alone; the centralised controller still assumes that the agent cooperates."""
        return AttackingController(self._whole.rows, self._i)
