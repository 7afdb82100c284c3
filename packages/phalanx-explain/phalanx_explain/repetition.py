"""The control steps of one agent of a recorded run, repeated in this process."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from phalanx_agent.controller import AgentController, DistributedController, StepResult
from phalanx_agent.step import ControlStep

from phalanx.launcher.engine import EngineError, RunOptions
from phalanx.launcher.simulation import Simulation
from phalanx.launcher.verify import INSTANT, commands_of, shortened
from phalanx.recording.read import Recording
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.information import ReceivedInput


class Knowledge(NamedTuple):
    """An agent's knowledge at one control step: the arguments of its controller."""

    x: Array
    """Stacked sampled state, shape (n̄,); NaN for agents that are not seen."""
    seen: tuple[int, ...]
    t: float
    """Time of the sample [s]."""
    received: Mapping[int, ReceivedInput]


class ControllerSteps:
    """A normal agent's controller that keeps what it was called with."""

    def __init__(self, rows: SafetyRows, i: int, wishes: Sequence[Array] = ()) -> None:
        """wishes: of its law at each step, if the law is not to be asked again."""
        self.rows, self.i = rows, i
        self.controller = DistributedController(rows, i)
        if wishes:
            remaining = iter(wishes)
            self.controller.nominal = lambda _: next(remaining)
        self._wishes: list[Array] = []
        self.steps: list[Knowledge] = []
        """Of all its control steps."""
        self.result: StepResult | None = None
        """Of the last one."""

    def __call__(
        self, x: Array, visible: tuple[int, ...], t: float, received: Mapping[int, ReceivedInput]
    ) -> StepResult:
        """Decide, as an AgentController does."""
        self.steps.append(Knowledge(x.copy(), visible, t, dict(received)))
        self.result = self.controller(x, visible, t, received)
        self._wishes.append(self.result.u_nom)
        return self.result

    def as_adversary(self) -> AgentController:
        """Return the controller of an attacker, whose steps are not kept."""
        return self.controller.as_adversary()

    @property
    def wish(self) -> Array:
        """Return the law's input at the last step, or the nearest to it in U_i, shape (m_i,)."""
        assert self.result is not None
        rows, i, now = self.rows.seen_by(self.i), self.i, self.steps[-1]
        inputs, u_nom = rows.terms(i)(now.x, now.seen).polytopes[i], self.result.u_nom
        u = rows.qp(i).solve(u_nom, inputs)
        return u_nom if u is None else u

    def under(self, rows: SafetyRows) -> "ControllerSteps":
        """Decide the same steps, with the same wishes, by other rows, which may see less far.

        The last step alone, unless radio or a fallback has a memory. A law may have one: it is not
        asked.
        """
        first = 0 if self.controller.radio or self.controller.keeper else len(self.steps) - 1
        other = ControllerSteps(rows, self.i, self._wishes[first:])
        for step in self.steps[first:]:
            near = set(rows.swarm.seen(self.i, step.x))  # of those out of sight x is no number
            other(*step._replace(seen=tuple([l for l in step.seen if l in near])))
        return other


def repeated(recording: Recording, agent: str, t: float) -> ControllerSteps:
    """Repeat a run up to the last sample of a normal agent at or before t [s].

    Raises EngineError: the run cannot be repeated, or no row made that agent's input.
    """
    if recording.step_data:
        raise EngineError("a run in real time cannot be repeated, and so not be explained")
    if recording.scenario.safety.centralised:
        raise EngineError("expected distributed control: one controller decides for all agents")
    decided = [step for step in recording.steps if step.agent == agent and step.t <= t + INSTANT]
    last = max(decided, key=lambda step: step.t, default=None)
    end = last.t if last else t
    rows = require_runnable(build_swarm(shortened(recording.scenario, end)))
    names = rows.swarm.names
    if agent not in names:
        raise EngineError(f"agent: expected one of {', '.join(names)}, got {agent}")
    i = names.index(agent)
    if i not in rows.swarm.normal or not rows.swarm.groups[i].filtered:
        raise EngineError(f"agent {agent}: expected a normal agent with rows: it has none")
    run = Simulation(rows, options=RunOptions("in-process", commands=commands_of(recording)))
    steps = ControllerSteps(rows, i)
    run.agents.steps[i] = ControlStep(rows, i, steps)
    run.advance()
    if not steps.steps or last is None or steps.steps[-1].t != last.t:
        raise EngineError(f"agent {agent} decided nothing at {t:g} s: it attacks, or was restarted")
    assert steps.result is not None
    if tuple(steps.result.decision.u.tolist()) != tuple(last.u):
        raise EngineError(
            f"agent {agent}: repeated, its controller decides otherwise at {last.t:g} s: it was "
            "hijacked, or its world or program does not repeat itself"
        )
    return steps
