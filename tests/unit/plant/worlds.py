"""Worlds for tests: one that is right, and three that go too far, start elsewhere or slip."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phalanx.extend import WorldAgent, WorldStates
from phalanx.network.draws import Draws
from phalanx.theory.models.world import Determinism

_counter = itertools.count()


@dataclass
class Unicycles:
    """Unicycles that drive at `gain` times the speed they are given, from `since` [s] on."""

    gain: float = 1.0
    since: float = 0.0
    determinism: Determinism = "bits"

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        self.t, self.step = 0.0, step
        self.x = {agent.name: np.array(agent.start) for agent in agents}
        self.u = {agent.name: np.zeros(2) for agent in agents}

    def reseed(self, seed: int) -> None:
        pass

    def hold(self, name: str, u: np.ndarray) -> None:
        if name not in self.u or np.shape(u) != (2,) or not np.isfinite(u).all():
            raise ValueError(f"expected a robot's two finite numbers, got {name}: {u}")
        self.u[name] = np.array(u)

    def advance(self, until: float) -> WorldStates:
        if until <= self.t:
            raise ValueError(f"expected more than {self.t}, got {until}")
        times = np.linspace(self.t, until, math.ceil((until - self.t) / self.step) + 1)[1:]
        times[-1] = until
        states = WorldStates(times, {name: self.moved(name, times) for name in self.x})
        self.t = until
        return states

    def moved(self, name: str, times: np.ndarray) -> np.ndarray:
        states, (v, w) = [self.x[name]], self.u[name]
        for before, t in itertools.pairwise([self.t, *times.tolist()]):
            x, y, heading = states[-1]
            turn, speed = w * (t - before) / 2, self.gain * v if t > self.since else v
            chord = speed * (t - before) * (math.sin(turn) / turn if turn else 1.0)
            middle = heading + turn
            here = x + chord * math.cos(middle), y + chord * math.sin(middle), heading + 2 * turn
            states.append(np.array(here))
        self.x[name] = states[-1]
        return np.array(states[1:])


@dataclass
class Overshooting(Unicycles):
    """Moves on past `until`."""

    def advance(self, until: float) -> WorldStates:
        return super().advance(until + 1e-4)


@dataclass
class Fickle(Unicycles):
    """Starts elsewhere each time."""

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        super().begin(agents, seed, step)
        self.x = {name: x + 1e-9 * next(_counter) for name, x in self.x.items()}


@dataclass
class Slippery(Unicycles):
    """Drives at a speed that each seed draws."""

    def begin(self, agents: Sequence[WorldAgent], seed: int, step: float) -> None:
        super().begin(agents, seed, step)
        self.reseed(seed)

    def reseed(self, seed: int) -> None:
        self.gain = 1.0 + 0.01 * float(Draws(seed, "slip")[0][0])
