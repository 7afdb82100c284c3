"""One agent's own thought: terms of the sample, u_nom input, row, QP."""

from collections.abc import Mapping
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from phalanx.agent.controllers import Attack, Controller, Moment, controller
from phalanx.swarm.swarm import Swarm
from phalanx.theory.laws.law import Law, View
from phalanx.theory.laws.worst_case import WorstCase
from phalanx.theory.rows.decision import Decision
from phalanx.theory.rows.information import ReceivedInput

Array = NDArray[np.float64]


class Thought(NamedTuple):
    """What came of a sample."""

    decision: Decision
    u_nom: Array
    """u_nom, shape (m_i,)."""
    used: list[int]
    """The agents whose û_l counted."""


class Mind(Protocol):
    """What turns one agent's samples into inputs."""

    def __call__(self, x: Array, t: float, heard: Mapping[int, ReceivedInput]) -> Thought:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s]."""

    def turned(self) -> "Mind":
        """The same agent's as an adversary."""


class Alone:
    """A mind of the agent's own, as in the distributed problem and in every adversary."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        """Compile agent i's own copy of the theory."""
        self._swarm, self._i = swarm, i
        self._normal, self._parts = swarm.normal, swarm.chain.set.parts
        self._law: Law = swarm.law(i)
        self._goal = swarm.goal_of(i)
        self._terms = swarm.terms(i)
        self._latency = swarm.scenario.time.latency
        self._controller: Controller = controller(swarm, i)

    def __call__(self, x: Array, t: float, heard: Mapping[int, ReceivedInput]) -> Thought:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s]."""
        terms = self._terms(x)
        goal = self._goal(t, terms.positions[self._i])
        states = [x[part] for part in self._parts]
        u_nom = self._law.input(View(self._i, states, self._normal, goal, terms))
        now = Moment(t + self._latency, x, terms, u_nom, heard)
        decision, used = self._controller(now)
        return Thought(decision, u_nom, used)

    def turned(self) -> Self:
        """It attacks from now on."""
        self._law, self._controller = WorstCase(), Attack(self._swarm, self._i)
        return self
