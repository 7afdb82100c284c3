"""What the plots are made of: the run's past, gathered frame by frame or read from a recording."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from phalanx.viewer.scene.model import SceneModel
from phalanx.wire.frames import Frame

Array = NDArray[np.float64]

TRAIL_EVERY = 0.2
"""Between two points of a trail [s]."""
_TRAIL_POINTS = 60
_ALL_TRAILS = 3000


class Table:
    """Rows of numbers, appended one by one or given at once."""

    def __init__(self, width: int, rows: Array | None = None) -> None:
        self._rows = np.zeros((256, width)) if rows is None else rows
        self._count = 0 if rows is None else len(rows)

    def append(self, *row: float) -> None:
        """Add a row."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1

    @property
    def rows(self) -> Array:
        """All rows so far, shape (s, width)."""
        return self._rows[: self._count]


class Trail:
    """Where agents were: positions a fixed time apart, the oldest forgotten."""

    def __init__(self, agents: int) -> None:
        self._past: deque[Array] = deque(maxlen=trail_length(agents))
        self._due = -np.inf

    def add(self, t: float, positions: Array) -> None:
        """Positions at t [s], shape (N, 3); kept if enough time has passed."""
        if t >= self._due:
            self._due = t + TRAIL_EVERY
            self._past.append(positions)

    @property
    def positions(self) -> Array:
        """shape (s, N, 3)"""
        return np.array(self._past)


def trail_length(agents: int) -> int:
    """How many points a trail may have, so that all of them stay a small message."""
    return max(4, min(_TRAIL_POINTS, _ALL_TRAILS // agents))


@dataclass(frozen=True)
class History:
    """A run's past."""

    swarm: Table
    """t, h_tot, smallest distance of a pair of agents, ψ_1 ... ψ_{q-1}."""
    agent: Callable[[int], Array]
    """One agent's rows: t, 1 at a backup step, age of the oldest û, solve time, its input."""


class Gathered:
    """The past of a live run, frame by frame."""

    def __init__(self, cast: SceneModel) -> None:
        self._cast = cast
        self.history = History(Table(2 + len(cast.swarm.chain.psi)), self._agent)
        self.trail = Trail(len(cast.names))
        self._steps = Table(1 + 3 * len(cast.names) + cast.inputs[-1].stop)
        """t; of every agent: backup, age, solve time; all inputs."""
        self._backups = np.zeros(len(cast.names))

    def add(self, frame: Frame) -> None:
        """Append what a frame says; a backup between two frames counts for the later one."""
        x = np.frombuffer(frame.x, dtype="<f8")
        positions, agents = self._cast.places(x).positions, frame.agents
        distance = self._cast.smallest_distance(positions)
        self.history.swarm.append(frame.t, frame.h_tot, distance, *self._cast.higher_psi(x))
        self.trail.add(frame.t, positions)
        backups = np.array([shown.backups for shown in agents], dtype=float)
        if all(shown.u for shown in agents):
            self._steps.append(
                frame.t,
                *(backups > self._backups),
                *[nan_if_none(shown.age) for shown in agents],
                *[shown.solve_time for shown in agents],
                *chain.from_iterable(shown.u for shown in agents),
            )
        self._backups = backups

    def _agent(self, i: int) -> Array:
        n, held = len(self._cast.names), self._cast.inputs[i]
        inputs = range(1 + 3 * n + held.start, 1 + 3 * n + held.stop)
        return np.asarray(self._steps.rows[:, [0, 1 + i, 1 + n + i, 1 + 2 * n + i, *inputs]])


def nan_if_none(value: float | None) -> float:
    """Plots leave out what is not a number."""
    return float("nan") if value is None else value


def until(rows: Array, t: float) -> Array:
    """The rows whose first number is at most t."""
    return rows[: np.searchsorted(rows[:, 0], t, side="right")]


def thinned(rows: Array, most: int) -> Array:
    """At most `most` rows that keep every column-1 peak: of each block the row where it is."""
    if len(rows) <= most:
        return rows
    edges = np.linspace(0, len(rows), most + 1).astype(int)
    peaks = [a + int(np.argmax(rows[a:b, 1])) for a, b in pairwise(edges)]
    return np.asarray(rows[peaks])
