"""Check that a world keeps its protocol."""

from collections.abc import Callable, Iterator, Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.world import World, WorldAgent, WorldStates, advanced

_TIME = 0.05
"""Time to move on [s]."""
_EQUAL = 1e-6
"""Allowed difference where an integrator takes other steps."""


class WorldMistakeError(AssertionError):
    """A world breaks a rule of its protocol, which the message names."""


def check_world(
    make: Callable[[], World], agents: Sequence[WorldAgent], step: float = 1e-3
) -> None:
    """Try a world: determinism, time, held inputs, divided advances, and refused inputs.

    Args:
        make: returns a new world at each call.
        agents: its robots, with the states to start from.
        step: longest time between two states [s].

    Raises:
        WorldMistakeError: it breaks a rule.
        MistakenMethodError: `advance` returns other times or shapes than it should.
    """
    _Trial(make, agents, step).run()


class _Trial:
    def __init__(
        self, make: Callable[[], World], agents: Sequence[WorldAgent], step: float
    ) -> None:
        self._make, self._agents, self._step = make, agents, step
        self._inputs = {agent.name: _some_input(agent.dynamics) for agent in agents}

    def run(self) -> None:
        """Try all rules in turn."""
        whole = self._moved(_TIME)
        if self._make().determinism != "none":
            self._require_same("same seed, same states", whole, self._moved(_TIME), 0.0)
        halves = self._moved(_TIME / 2, _TIME)
        self._require_same("two advances are one", whole, halves, _EQUAL)
        again = self._moved(_TIME / 2, _TIME, again=True)
        self._require_same("an input is held until the next one", halves, again, _EQUAL)
        for agent in self._agents:
            if self._close(self._moved(_TIME, without=agent.name), whole, agent.name, _EQUAL):
                raise WorldMistakeError(f"agent {agent.name}: its input does not move it")
        self._require_refusals()

    def _moved(self, *instants: float, again: bool = False, without: str = "") -> WorldStates:
        """Return the states that a new world reaches under the inputs."""
        world, now = self._begun(), 0.0
        for k, until in enumerate(instants):
            for name, u in self._inputs.items():
                if (k == 0 or again) and name != without:
                    world.hold(name, u)
            found = advanced(world, self._agents, now, until, self._step)
            now = until
        return found

    def _begun(self) -> World:
        world = self._make()
        world.begin(self._agents, 0, self._step)
        return world

    def _require_same(self, rule: str, a: WorldStates, b: WorldStates, allowed: float) -> None:
        for agent in self._agents:
            if not self._close(a, b, agent.name, allowed):
                raise WorldMistakeError(f"{rule}: agent {agent.name} ends elsewhere")

    def _close(self, a: WorldStates, b: WorldStates, name: str, allowed: float) -> bool:
        one, other = a.x[name][-1], b.x[name][-1]
        return bool((np.abs(one - other) <= allowed * (1.0 + np.abs(one))).all())

    def _require_refusals(self) -> None:
        for what, call in self._refused():
            try:
                call()
            except ValueError:
                continue
            except Exception as error:
                raise WorldMistakeError(
                    f"{what}: expected a ValueError, got {type(error).__name__}"
                ) from error
            raise WorldMistakeError(f"{what}: expected a ValueError, it was taken")

    def _refused(self) -> Iterator[tuple[str, Callable[[], object]]]:
        """Yield calls that a world must refuse, with their names."""
        world, (name, u) = self._begun(), next(iter(self._inputs.items()))
        world.advance(_TIME)
        yield "an input for an unknown name", lambda: world.hold(f"not-{name}", u)
        yield "an input of another shape", lambda: world.hold(name, np.append(u, 0.0))
        yield "an input that is not finite", lambda: world.hold(name, np.nan * u)
        yield "an advance into the past", lambda: world.advance(_TIME / 2)


def _some_input(dynamics: Dynamics) -> Array:
    """Return an input inside U, away from its centre."""
    polytope = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", len(dynamics.states))))
    if polytope is None:
        return np.full(len(dynamics.inputs), 0.1)
    corners = polytope.corners
    found: Array = 0.5 * corners[0] + 0.5 * corners.mean(axis=0)
    return found
