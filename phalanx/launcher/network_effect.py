"""Network effect: how far agents' inputs are from those that they would choose from the truth.

At each control step a twin of the agent's controller gets, in place of what the network brought,
the present states of others and the inputs that they decided last. The run is repeated in this
process; what twins choose is applied nowhere.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from phalanx_agent.controller import DistributedController

from phalanx.launcher.simulation import Simulation
from phalanx.messages.kinds import Sample
from phalanx.network.inbox import Statement
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.state_codec import StateCodec
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length


class StepEffect(NamedTuple):
    """The network effect at one control step of a normal agent."""

    agent: str
    t: float
    """Time of the sample [s]."""
    effect: float
    """‖u - u of the twin‖ as a share of the largest distance between two inputs of U_i at x(0)."""


def network_effect(scenario: Scenario) -> list[StepEffect]:
    """Repeat a run and measure the effect of its network; steps of adversaries are left out.

    Raises ValueError where one controller decides for all: it knows them without a network.
    """
    if scenario.safety.centralised:
        raise ValueError("expected distributed control: one controller knows all states and inputs")
    rows = require_runnable(build_swarm(scenario))
    run = Simulation(rows)
    twins = _Twins(rows, run)
    run.run()
    return twins.effects


class _Twins:
    """Twins of the controllers of one run."""

    def __init__(self, rows: SafetyRows, run: Simulation) -> None:
        swarm = self._swarm = rows.swarm
        self.effects = list[StepEffect]()
        self._run, self._states = run, StateCodec(swarm)
        self._twins = {i: DistributedController(rows, i) for i in swarm.normal}
        self._widths = {i: _width(rows, i) for i in swarm.normal}
        self._decided = {i: np.zeros(len(m.dynamics.inputs)) for i, m in enumerate(swarm.members)}
        """By agent, its last input, shape (m_i,)."""
        self._answer, run.agents.send_sample = run.agents.send_sample, self._compare  # type: ignore[method-assign]

    def _compare(self, i: int, sample: Sample) -> None:
        """Have agent i answer its sample, and compare its input with the twin's."""
        turned = sample.commands is not None and sample.commands.adversary
        if normal := i in self._twins and not turned:
            x = self._states.unpack(sample.x, sample.seen)
            twin = self._twins[i](x, sample.seen, sample.t, self._present(i, sample.t)).decision.u
        self._answer(i, sample)
        self._decided[i] = u = self._run.agents.decided(i)
        if normal:
            change = float(length(u - twin)) / self._widths[i]
            self.effects.append(StepEffect(self._swarm.names[i], sample.t, change))

    def _present(self, i: int, t: float) -> Mapping[int, Statement]:
        """Return what agent i would receive at t [s] over a network without delay and loss."""
        x, parts = self._run.clock.world.x, self._swarm.safe_set.parts
        states = {l: tuple(x[parts[l]].tolist()) for l in self._swarm.heard_by(i)}
        return {
            l: Statement(
                sender=l, k=0, t_apply=t, u=tuple(self._decided[l].tolist()), t=t, x=state, z=state
            )
            for l, state in states.items()
        }


def _width(rows: SafetyRows, i: int) -> float:
    """The largest distance between two inputs of agent i at the start."""
    start = rows.swarm.start()
    corners: Array = rows.terms(i)(start, rows.swarm.seen(i, start)).polytopes[i].corners
    return float(length(corners[:, None] - corners).max())
