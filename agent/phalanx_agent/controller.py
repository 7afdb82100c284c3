"""Controllers: an agent's own, or its part of the centralised one."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Protocol, Self

from msgspec import Struct
from msgspec.structs import replace

from phalanx.guarantee.certificates import certified_for
from phalanx.guarantee.proven_filter import ProvenFilter
from phalanx.messages.step_report import StepReport
from phalanx.schema.registry import construct
from phalanx.swarm.own_controller import own_controller
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import CheckedInput, Law, View
from phalanx.theory.rows.centralised import JointInput
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.information import ReceivedInput
from phalanx.theory.rows.safety_filter import FilterInput


class StepResult(Struct, frozen=True):
    """The result of a control step."""

    decision: Decision
    u_nom: Array
    """The nominal input, or the attack before its projection, shape (m_i,)."""
    used: list[int]
    """The agents whose û_l counted."""
    notes: Mapping[str, float] = MappingProxyType({})
    """Numbers that another controller than the paper's wants recorded."""
    claimed: Array | None = None
    """The input that it broadcasts, shape (m_i,); None for the one that it applies."""

    def report(self, solve_time: float) -> StepReport:
        """Make the report of the decision; solve_time: its wall time [s]."""
        decision = self.decision
        return StepReport(
            u_nom=tuple(self.u_nom.tolist()),
            origin=decision.origin,
            residual=decision.residual,
            margin=decision.margin,
            proven=decision.proven,
            solve_time=solve_time,
        )


class AgentController(Protocol):
    """One agent's controller: its own, or its part of the centralised one."""

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s].

        x is NaN for agents that are not in `visible`.
        """

    def as_adversary(self) -> "AgentController":
        """Return the agent's controller after a command has made it an adversary."""


class DistributedController:
    """An agent's own law, row and QP, as in (QPdistributed); or another controller's input."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        """Compile agent i's own copy of the theory."""
        self._everything, self._i = rows, i
        rows = rows.seen_by(i)
        swarm = rows.swarm
        self._members, self._parts = swarm.members, swarm.safe_set.parts
        self._nominal = CheckedInput(swarm.law(i), swarm.members[i])
        self._goal = swarm.goal(i)
        self._terms = rows.terms(i)
        self._filter = rows.filter(i)
        if swarm.safety.prove and not swarm.members[i].adversary:
            self._filter = ProvenFilter(rows, i, self._filter)
        self._override = own_controller(rows, i, certified_for(swarm, i))
        self._latency = swarm.time.latency

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide, as an AgentController does."""
        view = self._view(x, visible, t)
        u_nom = self._nominal(view)
        if self._override is not None:
            decision, notes = self._override(view, u_nom, x, visible, t, received)
            return StepResult(decision, u_nom, [], notes)
        now = FilterInput(t + self._latency, x, visible, view.terms, u_nom, received)
        filtered = self._filter(now)
        return StepResult(filtered.decision, u_nom, filtered.used)

    def _view(self, x: Array, visible: tuple[int, ...], t: float) -> View:
        i, terms = self._i, self._terms(x, visible)
        states = {l: x[self._parts[l]] for l in visible}
        goal = self._goal(t, states)
        normal = [l for l in visible if not self._members[l].adversary]
        return View(i, states, normal, goal, terms, t)

    def as_adversary(self) -> Self:
        """Attack from now on, without a row; an adversary knows everything."""
        rows = self._everything
        self._members = rows.swarm.members
        self._nominal = CheckedInput(construct(Law, {"type": "worst"}), self._members[self._i])
        self._terms, self._filter = rows.terms(self._i), rows.unfiltered(self._i)
        self._override = None
        return self


class HijackedController:
    """An attack behind the broadcasts of the controller that it replaced."""

    def __init__(self, honest: AgentController, attack: AgentController) -> None:
        self._honest, self._attack = honest, attack

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide, as an AgentController does."""
        claimed = self._honest(x, visible, t, received).decision.u
        return replace(self._attack(x, visible, t, received), claimed=claimed)

    def as_adversary(self) -> AgentController:
        """Attack openly."""
        return self._attack


class CentralisedController:
    """The controller of Theorem 1: (QPmultiple), solved once for all normal agents."""

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

    def as_adversary(self) -> DistributedController:
        """Attack alone; the centralised controller still assumes that the agent cooperates."""
        return DistributedController(self._whole.rows, self._i).as_adversary()
