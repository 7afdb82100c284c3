"""Each agent's goal as a function of the time and of the states that it sees."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.model import Scenario
from phalanx.scenario.placement import Flow
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import MistakenMethodError, is_built_in
from phalanx.theory.laws.formation import Slot
from phalanx.theory.laws.goals import Goal, Motion, Reference, Sight, Stay, Waypoints
from phalanx.theory.models.dynamics import Dynamics


def reference_of(scenario: Scenario, i: int, group: AgentGroup, number: int) -> Reference:
    """Build a new reference of agent i, the `number`-th of its group.

    It is the agent's own goal, its formation slot, its place in the flows, or to stay.
    """
    if group.goal:
        return group.goal[number].reference()
    if group.slots and scenario.formation:
        return Slot(scenario.formation, group.slots[number])
    if scenario.flows:
        return Flow(scenario.flows, i, np.array(group.start[number][: group.axes]))
    return Stay()


class Output(NamedTuple):
    """An agent's output point as a function of its state."""

    i: int
    function: CompiledFunction
    """p [m] and the drift of p [m/s], shape (2 d,), at a state, shape (n_i,)."""

    def __call__(self, x: Array) -> Motion:
        p, velocity = self.function(x)[0].reshape(2, -1)
        return Motion(p, velocity)


def motion_function(dynamics: Dynamics) -> CompiledFunction:
    """Compile the output point p [m] and ∂p/∂x f [m/s], stacked, as a function of the state."""
    x = ca.SX.sym("x", len(dynamics.states))
    p = dynamics.position(x)
    return CompiledFunction([x], [ca.vertcat(p, ca.jacobian(p, x) @ dynamics.drift(x))])


@dataclass(frozen=True)
class AgentGoal:
    """An agent's goal at t [s], given the states that it sees, its own among them."""

    agent: str
    axes: int
    reference: Reference
    outputs: Mapping[str, Output]
    """Of every agent, by name."""

    def __call__(self, t: float, states: Mapping[int, Array]) -> Goal:
        """Return the goal. Raises MistakenMethodError of a user's reference."""
        return self._goal(Sight(t, self.agent, partial(self._motion, states)))

    def positions(self, t: Array, states: Sequence[Mapping[int, Array]]) -> Array:
        """Return the goal's places at s times [s], given the states at each, shape (s, d) [m]."""
        if isinstance(self.reference, Slot):
            return self.reference.formation.positions(self.reference.slot, t)
        positions = [self(at, x).position for at, x in zip(t.tolist(), states, strict=True)]
        return np.array(positions)

    @cached_property
    def _goal(self) -> Callable[[Sight], Goal]:
        return self.reference.goal if is_built_in(self.reference) else self._users_goal

    def _users_goal(self, sight: Sight) -> Goal:
        try:
            goal = self.reference.goal(sight)
        except MistakenMethodError as error:
            error.name_agent(self.agent)
            raise
        if not (isinstance(goal, Goal) and all(map(self._is_vector, goal))):
            raise self._mistaken("goal", "a Goal of three numpy arrays", goal)
        return goal

    @property
    def of_now(self) -> bool:
        """Return whether the goal depends on time and sample alone; only one built-in does not."""
        kept = isinstance(self.reference, Waypoints) and not self.reference.times
        return is_built_in(self.reference) and not kept

    def end(self) -> Array | None:
        """Return where the goal comes to rest [m]. Raises MistakenMethodError as a call does."""
        end = self.reference.end()
        if end is not None and not self._is_vector(end):
            raise self._mistaken("end", "None or a numpy array", end)
        return end

    def _mistaken(self, method: str, what: str, got: object) -> MistakenMethodError:
        expected = f"{what} of {self.axes} finite numbers for agent {self.agent}"
        return MistakenMethodError(self.reference, method, expected, repr(got))

    def _is_vector(self, value: object) -> bool:
        if not isinstance(value, np.ndarray) or value.shape != (self.axes,):
            return False
        return value.dtype.kind in "fi" and bool((np.abs(value) <= LARGEST).all())

    def _motion(self, states: Mapping[int, Array], agent: str) -> Motion | None:
        output = self.outputs.get(agent)
        if output is None or output.i not in states:
            return None
        return output(states[output.i])
