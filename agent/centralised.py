"""The one controller of Theorem 1: (QPmultiple), solved once for all normal agents."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from phalanx.agent.distributed import Alone, Thought
from phalanx.swarm.swarm import Swarm
from phalanx.theory.laws.law import View
from phalanx.theory.rows.centralised import JointInput
from phalanx.theory.rows.information import ReceivedInput

Array = NDArray[np.float64]


class Together:
    """What all normal agents do at one sampled state."""

    def __init__(self, swarm: Swarm) -> None:
        """Compile the theory once for all."""
        safety, first = swarm.scenario.safety, swarm.normal[0]
        self.swarm, self._normal = swarm, swarm.normal
        self._eta, self._scale = swarm.eta(first), safety.margin_scale
        self._authority = safety.authority
        self._laws = [swarm.law(l) for l in self._normal]
        self._goals = [swarm.goal_of(l) for l in self._normal]
        self._parts = swarm.chain.set.parts
        self._terms = swarm.terms(first)
        self._qp = JointInput([swarm.members[l].dynamics for l in self._normal])
        self._sampled: tuple[float, bytes] | None = None
        self._thoughts: dict[int, Thought] = {}

    def at(self, x: Array, t: float) -> dict[int, Thought]:
        """Every normal agent's input for the state x, shape (n̄,), sampled at t [s].

        Agents that sample together share one solution; those that do not, as Theorem 1 would
        have it, get one each.
        """
        sampled = t, x.tobytes()
        if sampled != self._sampled:
            self._sampled, self._thoughts = sampled, self._decide(x, t)
        return self._thoughts

    def _decide(self, x: Array, t: float) -> dict[int, Thought]:
        terms, normal = self._terms(x), self._normal
        states = [x[part] for part in self._parts]
        u_nom = [
            law.input(View(l, states, normal, goal(t, terms.positions[l]), terms))
            for l, law, goal in zip(normal, self._laws, self._goals, strict=True)
        ]
        eta = self._scale * (self._eta + terms.margin)
        decisions = self._qp.decide(terms, normal, u_nom, eta, self._authority)
        return {
            l: Thought(decision, u_nom, [])
            for l, decision, u_nom in zip(normal, decisions, u_nom, strict=True)
        }


class Part:
    """One agent's mind, which is the controller's."""

    def __init__(self, together: Together, i: int) -> None:
        self._together, self._i = together, i

    def __call__(self, x: Array, t: float, heard: Mapping[int, ReceivedInput]) -> Thought:
        """Decide on the stacked state x, shape (n̄,), sampled at t [s]."""
        return self._together.at(x, t)[self._i]

    def turned(self) -> Alone:
        """It leaves the controller, which goes on counting on it."""
        return Alone(self._together.swarm, self._i).turned()
