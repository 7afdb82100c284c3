"""Checks that a world of your own keeps what its protocol says."""

import contextlib
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import get_args

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.world import (
    Determinism,
    World,
    WorldAgent,
    advanced,
    moves_by_itself,
)

_TIME = 0.05
"""Time to move on [s]."""
_EQUAL = 1e-6
"""Allowed difference where an integrator takes other steps."""
_LIKE = 0.3
"""Allowed difference where nothing repeats, as a share of what the input changes."""
_OFF = 0.05
"""Allowed difference of the first state from the start, as a share of its components."""


class WorldMistakeError(AssertionError):
    """A world breaks a rule of its protocol, which the message names."""


def check_world(
    make: Callable[[], World], agents: Sequence[WorldAgent], step: float = 1e-3
) -> None:
    """Try a world: start, determinism, time, held inputs, divided advances, and refused inputs.

    A world without determinism need not repeat itself: what its inputs change must be similar.

    Args:
        make: returns a new world at each call.
        agents: its robots, with the states to start from.
        step: longest time between two states [s].

    Raises:
        WorldMistakeError: it breaks a rule.
        MistakenMethodError: `advance` returns other times or shapes than it should.
    """
    _Trial(make, agents, step).run()


_Ends = Mapping[str, Array]
"""State of each robot at the end."""


class _Trial:
    def __init__(
        self, make: Callable[[], World], agents: Sequence[WorldAgent], step: float
    ) -> None:
        self._make, self._agents, self._step = make, agents, step
        self._inputs = {agent.name: _some_input(agent.dynamics) for agent in agents}
        self._repeats = make().determinism != "none"

    def run(self) -> None:
        """Try all rules in turn."""
        if (got := self._make().determinism) not in get_args(Determinism):
            raise WorldMistakeError(f"determinism: expected bits, build or none, got {got}")
        zeros = {name: 0.0 * u for name, u in self._inputs.items()}
        rest, whole = self._moved(_TIME, inputs=zeros), self._moved(_TIME)
        for agent in self._agents:
            others = {name: u for name, u in self._inputs.items() if name != agent.name}
            without = self._moved(_TIME, inputs=others)[agent.name]
            if _equal(without, whole[agent.name], _EQUAL):
                raise WorldMistakeError(f"agent {agent.name}: its input does not move it")
        effect = {name: float(np.abs(x - rest[name]).max()) for name, x in whole.items()}

        def require(rule: str, a: _Ends, b: _Ends, allowed: float = _EQUAL) -> None:
            for name, x in a.items():
                like = np.abs(x - b[name]).max() <= _LIKE * effect[name]
                if not (_equal(x, b[name], allowed) if self._repeats else like):
                    raise WorldMistakeError(f"{rule}: agent {name} ends elsewhere")

        require("an input is zero until the first one", rest, self._moved(_TIME, inputs={}))
        require("same seed, same states", whole, self._moved(_TIME), 0.0)
        halves = self._moved(_TIME / 2, _TIME)
        require("two advances are one", whole, halves)
        again = self._moved(_TIME / 2, _TIME, again=True)
        require("an input is held until the next one", halves, again)
        first, second = (self._moved(_TIME / 2, _TIME, reseed=7) for _ in range(2))
        require("same new seed, same states", first, second, 0.0)
        self._require_refusals()

    def _moved(
        self,
        *instants: float,
        inputs: Mapping[str, Array] | None = None,
        again: bool = False,
        reseed: int | None = None,
    ) -> _Ends:
        """Return the states that a new world reaches under the inputs."""
        inputs = self._inputs if inputs is None else inputs
        now, advances = 0.0, list[_Ends]()
        copies: _Ends = {}
        with self._begun() as world:
            for k, until in enumerate(instants):
                for name, u in inputs.items():
                    if k == 0 or again:
                        argument = u.copy()
                        world.hold(name, argument)
                        argument[:] = np.nan  # an array that is not the world's
                if k and reseed is not None:
                    world.reseed(reseed)
                self._wait(world, until)
                advances.append(advanced(world, self._agents, now, until, self._step).x)
                copies = copies if k else {name: x.copy() for name, x in advances[0].items()}
                now = until
        for agent in self._agents:
            first, *later = (x[agent.name] for x in advances)
            if not np.isfinite([x[-1] for x in (first, *later)]).all():
                mistake = "states are not finite; does hold copy its input?"
                raise WorldMistakeError(f"agent {agent.name}: {mistake}")
            if not np.array_equal(first, copies[agent.name]):
                raise WorldMistakeError(f"agent {agent.name}: a later advance changed its states")
            self._require_start(agent, first[0])
        return {name: x[-1] for name, x in advances[-1].items()}

    def _require_start(self, agent: WorldAgent, first: Array) -> None:
        drift = ca.evalf(agent.dynamics.drift(ca.SX(ca.DM(agent.start))))
        moved = self._step * np.abs(np.array(drift).ravel())
        if (np.abs(first - agent.start) > moved + _OFF * (1.0 + np.abs(agent.start))).any():
            raise WorldMistakeError(f"agent {agent.name}: it starts elsewhere")

    @contextlib.contextmanager
    def _begun(self) -> Iterator[World]:
        world = self._make()
        try:
            world.begin(self._agents, 0, self._step)
            self._start = time.monotonic()
            yield world
        finally:
            if callable(close := getattr(world, "close", None)):
                close()

    def _wait(self, world: World, until: float) -> None:
        """Wait until a world that moves by the wall clock is there."""
        while moves_by_itself(world) and time.monotonic() < self._start + until:
            time.sleep(self._step)

    def _require_refusals(self) -> None:
        with self._begun() as world:
            self._wait(world, _TIME)
            world.advance(_TIME)
            for attempt, call in self._refused(world):
                try:
                    call()
                except ValueError:
                    continue
                except Exception as error:
                    raise WorldMistakeError(
                        f"{attempt}: expected a ValueError, got {type(error).__name__}"
                    ) from error
                raise WorldMistakeError(f"{attempt}: expected a ValueError, it was taken")

    def _refused(self, world: World) -> Iterator[tuple[str, Callable[[], object]]]:
        """Yield calls that a world must refuse, with their names."""
        name, u = next(iter(self._inputs.items()))
        yield "an input for an unknown name", lambda: world.hold(f"not-{name}", u)
        yield "an input of another shape", lambda: world.hold(name, np.append(u, 0.0))
        yield "an input that is not finite", lambda: world.hold(name, np.nan * u)
        yield "an advance to now", lambda: world.advance(_TIME)
        yield "an advance into the past", lambda: world.advance(_TIME / 2)


def _equal(a: Array, b: Array, allowed: float) -> bool:
    return bool((np.abs(a - b) <= allowed * (1.0 + np.abs(a))).all())


def _some_input(dynamics: Dynamics) -> Array:
    """Return an input inside U, away from its centre."""
    polytope = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", len(dynamics.states))))
    if polytope is None:
        return np.full(len(dynamics.inputs), 0.1)
    corners = polytope.corners
    between: Array = 0.5 * corners[0] + 0.5 * corners.mean(axis=0)
    return between
