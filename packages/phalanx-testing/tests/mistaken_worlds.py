"""Worlds that break a rule each, and the plant's own integration as one that breaks none."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from phalanx_plant.world.world import RungeKutta, Segment

from phalanx.extend import WorldAgent, WorldStates
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.models.world import Determinism
from tests.unit.plant.worlds import Unicycles

_counter = itertools.count()


@dataclass
class Coarse(Unicycles):
    """Returns too few states."""

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        super().begin(agents, seed, 10.0 * step)


@dataclass
class Forgetful(Unicycles):
    """Drops every input at the end of an advance."""

    def advance(self, until: float) -> WorldStates:
        found = super().advance(until)
        self.u = {name: 0.0 * u for name, u in self.u.items()}
        return found


@dataclass
class Deaf(Unicycles):
    """Does not pass on inputs."""

    def hold(self, name: str, u: np.ndarray) -> None:
        super().hold(name, 0.0 * u)


@dataclass
class Trusting(Unicycles):
    """Takes any number."""

    def hold(self, name: str, u: np.ndarray) -> None:
        super().hold(name, np.nan_to_num(u))


@dataclass
class Misplaced(Unicycles):
    """Starts all robots at the origin."""

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        super().begin(agents, seed, step)
        self.x = {name: 0.0 * x for name, x in self.x.items()}


@dataclass
class Restless(Unicycles):
    """Drives before it is given an input."""

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        super().begin(agents, seed, step)
        self.u = {name: u + 1.0 for name, u in self.u.items()}


@dataclass
class Borrowing(Unicycles):
    """Keeps the array that it is given."""

    def hold(self, name: str, u: np.ndarray) -> None:
        super().hold(name, u)
        self.u[name] = u


@dataclass
class Overwriting(Unicycles):
    """Returns the same arrays at each advance."""

    def advance(self, until: float) -> WorldStates:
        states, before = super().advance(until), getattr(self, "returned", None)
        if before is None:
            self.returned = states
            return states
        for name, x in states.x.items():
            before.x[name][:] = x[-len(before.x[name]) :]
        return states


@dataclass
class Jumping(Unicycles):
    """Is elsewhere after each new seed."""

    def reseed(self, seed: int) -> None:
        self.x = {name: x + 1e-9 * next(_counter) for name, x in self.x.items()}


@dataclass
class Patient(Unicycles):
    """Stands still where it is asked for the time that it has."""

    def advance(self, until: float) -> WorldStates:
        if until == self.t:
            return WorldStates(np.array([until]), {name: x[None] for name, x in self.x.items()})
        return super().advance(until)


class Declared:
    """The plant's own integration as a world."""

    determinism: Determinism = "bits"

    def __init__(self, rows: SafetyRows) -> None:
        self._rows = rows

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        self._integration = RungeKutta(self._rows)
        self._agents = {agent.name: i for i, agent in enumerate(agents)}

    def reseed(self, seed: int) -> None:
        pass

    def hold(self, name: str, u: np.ndarray) -> None:
        if name not in self._agents or not np.isfinite(u).all():
            raise ValueError(f"expected finite numbers for an agent, got {name}: {u}")
        self._integration.hold(self._agents[name], u)

    def advance(self, until: float) -> WorldStates:
        if until <= self._integration.t:
            raise ValueError(f"expected more than {self._integration.t}, got {until}")
        pieces = [p for p in self._integration.integrate(until) if isinstance(p, Segment)]
        times = np.concatenate([p.t + p.dt * np.arange(1, len(p.x) + 1) for p in pieces])
        x, parts = np.concatenate([p.x for p in pieces]), self._rows.swarm.safe_set.parts
        times[-1] = until
        return WorldStates(times, {name: x[:, parts[i]] for name, i in self._agents.items()})
