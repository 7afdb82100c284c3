"""An agent's own controller: its law, rows and QP."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Protocol

from msgspec import Struct
from msgspec.structs import replace

from phalanx.messages.step_report import StepReport
from phalanx.network.inbox import Conviction
from phalanx.schema.registry import part_of_agent
from phalanx.swarm.attack import Attack
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.laws.law import CheckedInput, StateBox, View
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.information import ReceivedInput
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.safety_filter import FilterInput, SafetyFilter


class StepResult(Struct, frozen=True):
    """The result of a control step."""

    decision: Decision
    u_nom: Array
    """The nominal input, or the attack before its projection, shape (m_i,)."""
    used: list[int]
    """The agents whose û_l counted."""
    notes: Mapping[str, float] = MappingProxyType({})
    """Numbers that another controller than the paper's wants recorded."""
    reference: Array | None = None
    """Its reference state, shape (n_i,), which its peers by radio get; None for the state."""
    claimed: Array | None = None
    """The input that it broadcasts, shape (m_i,); None for the one that it applies."""
    convictions: Sequence[Conviction] = ()
    """Of peers by radio whose states contradict each other."""

    def report(self, solve_time: float) -> StepReport:
        """Make the report of the decision; solve_time: its wall time [s]."""
        decision = self.decision
        return StepReport(
            u_nom=tuple(self.u_nom.tolist()),
            origin=decision.origin,
            residual=decision.residual,
            margin=decision.margin,
            proven=decision.proven,
            binding=decision.binding,
            solve_time=solve_time,
        )


class Beliefs(Protocol):
    """An agent's knowledge of its peers by radio, after a call at its newest sample."""

    @property
    def convictions(self) -> Sequence[Conviction]:
        """New convictions, of peers that contradicted themselves."""

    @property
    def age(self) -> Mapping[int, float]:
        """Time since what is known of each peer was sampled [s]."""

    def boxes(self) -> Mapping[int, StateBox]:
        """Return for each peer the box in which it is."""

    def __call__(
        self, x: Array, seen: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> tuple[Array, tuple[int, ...]]:
        """Add the states of its peers as it believes them to the stacked state x at t [s].

        Returns x and the agents in it.
        """


class KeptInput(Protocol):
    """The input that a rule lets through, or puts in its place."""

    @property
    def u(self) -> Array:
        """Shape (m_i,)."""

    @property
    def accepted(self) -> bool:
        """True if it is the one that was asked for."""


class RadioFilter(SafetyFilter, Protocol):
    """The filter of an agent that knows peers by radio."""

    @property
    def with_beliefs(self) -> Beliefs:
        """Its knowledge of them."""

    @property
    def reference(self) -> Array | None:
        """The reference state at the last sample, shape (n_i,); None if there is none."""


class AgentController(Protocol):
    """Decides on one agent's inputs."""

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s].

        x is NaN for agents that are not in `visible`.
        """


class FirstController(AgentController, Protocol):
    """An agent's controller at first: its own, or its part of the centralised one."""

    def as_adversary(self) -> AgentController:
        """Return the agent's controller after a command has made it an adversary."""


class DistributedController:
    """An agent's own law, row and QP, as in (QPdistributed); or another controller's input."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        """Compile agent i's own copy of the theory."""
        self._everything, self._i = rows, i
        rows = rows.seen_by(i)
        swarm = rows.swarm
        self._members, self._parts = swarm.members, swarm.safe_set.parts
        self.nominal: Callable[[View], Array] = CheckedInput(swarm.law(i), swarm.members[i])
        self._goal = swarm.goal(i)
        self._terms = rows.terms(i)
        self._filter = rows.filter(i)
        self.radio: RadioFilter | None = None
        if swarm.peers(i):
            self._filter = self.radio = part_of_agent("agents.radio")(rows, i)
        if swarm.safety.prove and not swarm.members[i].adversary:
            self._filter = part_of_agent("safety.prove")(rows, i, self._filter)
        self._override: Callable[..., tuple[Decision, dict[str, float]]] | None = None
        self._wish: Callable[..., tuple[Array, dict[str, float]]] | None = None
        group = swarm.groups[i]
        if not group.filtered:
            self._override = part_of_agent("agents.controller")(rows, i)
        elif group.filter:
            self._wish = part_of_agent("agents.controller")(rows, i).wish
        self._latency = swarm.time.latency
        self.keeper: Callable[..., KeptInput] | None = None
        if swarm.safety.committed and not swarm.members[i].adversary:
            self.keeper = part_of_agent("safety.keep")(swarm, i)

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide, as an AgentController does, by the fallback where none would remain."""
        result = self._decided(x, visible, t, received)
        if self.keeper is None:
            return result
        allowed = self.keeper(t, x, visible, result.decision.u)
        if allowed.accepted:
            return result
        decision = replace(result.decision, u=allowed.u, origin=Origin.FALLBACK)
        return replace(result, decision=decision)

    def _decided(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        radio, convictions = self.radio, tuple[Conviction, ...]()
        if radio is not None:
            x, visible = radio.with_beliefs(x, visible, t, received)
        view = self._view(x, visible, t)
        if radio is not None:
            beliefs = radio.with_beliefs
            convictions = tuple(beliefs.convictions)
            view = replace(view, age=beliefs.age, boxes=beliefs.boxes)
        u_nom = self.nominal(view)
        if self._override is not None:
            decision, notes = self._override(view, u_nom, x, visible, t, received)
            return StepResult(decision, u_nom, [], notes, convictions=convictions)
        notes = {}
        if self._wish is not None:
            u_nom, notes = self._wish(view, u_nom, x, visible, t, received)
        now = FilterInput(t + self._latency, x, visible, view.terms, u_nom, received)
        filtered = self._filter(now)
        reference = radio.reference if radio is not None else None
        return StepResult(
            filtered.decision,
            u_nom,
            filtered.used,
            notes,
            reference=reference,
            convictions=convictions,
        )

    def _view(self, x: Array, visible: tuple[int, ...], t: float) -> View:
        i, terms = self._i, self._terms(x, visible)
        states = {l: x[self._parts[l]] for l in visible}
        goal = self._goal(t, states)
        normal = [l for l in visible if not self._members[l].adversary]
        return View(i, states, normal, goal, terms, t)

    def as_adversary(self) -> AgentController:
        """Attack from now on."""
        return AttackingController(self._everything, self._i)


class AttackingController:
    """The controller of an agent that was taken over."""

    def __init__(self, rows: SafetyRows, i: int) -> None:
        self._attack = Attack(rows, i)

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide, as an AgentController does."""
        return StepResult(*self._attack(x, visible, t), [])


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
