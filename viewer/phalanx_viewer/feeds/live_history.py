"""The past of a live run, gathered frame by frame."""

from collections import deque
from itertools import chain

import numpy as np

from phalanx.arrays import Array
from phalanx.curves.history import (
    EMPTY_CODES,
    AgentSeries,
    ConditionChange,
    Fates,
    PairSeries,
    agent_series,
    pair_states,
    series_width,
    smallest_distance,
)
from phalanx.faults.commands import Condition
from phalanx.guarantee.verdict import Violation
from phalanx.recording.broadcasts import Broadcast
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import AgentStatus, Frame, LogLine
from phalanx.wire.step_report import numbers_of
from phalanx_viewer.feeds.feed import SPACING, path_points
from phalanx_viewer.scene.model import SceneModel

_FIRST_CAPACITY = 256
_PAIR_STATES = 200
"""Most states of a run at which h of every pair is told."""


class _TimeSeries:
    """Rows of numbers, time [s] first, appended one by one."""

    def __init__(self, width: int) -> None:
        self._rows, self._count = np.zeros((_FIRST_CAPACITY, width)), 0

    def append(self, row: Array | list[float]) -> None:
        """Add a row, shape (width,)."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1

    @property
    def rows(self) -> Array:
        """All rows so far, shape (s, width)."""
        return self._rows[: self._count]


class LiveHistory:
    """A `History` of the frames that were added, and their recent paths."""

    broadcasts: tuple[Broadcast, ...] = ()

    def __init__(self, model: SceneModel) -> None:
        n, m = len(model.names), model.kinematics.inputs[-1].stop
        self._model = model
        self._totals = _TimeSeries(3 + len(model.values.psi_levels))
        self._path: deque[Array] = deque(maxlen=path_points(n))
        self._path_due = -np.inf
        self._scalars = series_width(0) - 1
        """How many numbers of AgentSeries each agent has after t, before its inputs."""
        self._steps = _TimeSeries(1 + self._scalars * n + 2 * m)
        """t; each of these of every agent; all u, all u_nom."""
        pairs = len(model.swarm.safe_set.pairs)
        self._pairs = _TimeSeries(1 + pairs)
        self._pairs_due = -np.inf
        self._pairs_spacing = model.scenario.duration / pair_states(pairs, _PAIR_STATES)
        self._late_or_lost = _TimeSeries(1 + 2 * n)
        """t; how many links to every agent were late since the row before, how many lost."""
        self._links_to = np.array([len(model.swarm.heard_by(i)) for i in range(n)], dtype=float)
        self._empty = np.zeros((2, n))
        self._condition = [Condition.FINE] * n
        self.conditions: list[ConditionChange] = []
        self.log: list[LogLine] = []
        self.violations: dict[str, Violation] = {}
        """By pair, as it was last told: a frame tells the worst ones alone."""

    def add(self, frame: Frame) -> None:
        """Append what a frame says."""
        x = np.frombuffer(frame.x, dtype="<f8")
        positions = self._model.kinematics.poses(x).positions
        distance = smallest_distance(self._model.swarm, positions)
        psi = self._model.values.higher_psi(x)
        self._totals.append([frame.t, frame.h_tot, distance, *psi])
        if frame.t >= self._path_due:
            self._path_due = frame.t + SPACING
            self._path.append(positions)
        if frame.t >= self._pairs_due:
            self._pairs_due = frame.t + self._pairs_spacing
            self._pairs.append(np.append(frame.t, self._model.values.every_h(x)))
        if not self._model.crowded:
            self._add_fates(frame)
        self._add_steps(frame.t, frame.agents)
        self._add_conditions(frame)
        self.violations.update((violation.pair, violation) for violation in frame.violations)
        # A frame tells the last lines alone, most of which were told before.
        self.log += [line for line in frame.log if line not in self.log[-len(frame.log) :]]

    def _add_steps(self, t: float, agents: tuple[AgentStatus, ...]) -> None:
        # A frame tells of each agent's last step alone. Its counts tell whether K_i was empty among
        # the steps between two frames; it is plotted at the later frame.
        empty = np.array([(s.backups, s.without_authority) for s in agents], dtype=float).T
        more = empty > self._empty
        steps = [status.step for status in agents if status.step is not None]
        if len(steps) == len(agents):
            codes = np.where(
                more[1], EMPTY_CODES[Origin.NO_AUTHORITY], EMPTY_CODES[Origin.BACKUP] * more[0]
            )
            # NumPy makes NaN of None.
            of_each = np.array([numbers_of(s) for s in steps], dtype=float).T.ravel()
            u = [*chain.from_iterable(s.u for s in steps)]
            u_nom = [*chain.from_iterable(s.u_nom for s in steps)]
            self._steps.append(np.concatenate([[t], codes, of_each, u, u_nom]))
        self._empty = empty

    def _add_fates(self, frame: Frame) -> None:
        # A frame tells the worst that became of each link since the frame before.
        n, events = len(self._links_to), frame.link_events
        late = np.bincount([e.receiver for e in events if e.delay >= 0.0], minlength=n)
        lost = np.bincount([e.receiver for e in events if e.delay < 0.0], minlength=n)
        self._late_or_lost.append([frame.t, *late, *lost])

    def _add_conditions(self, frame: Frame) -> None:
        for i, status in enumerate(frame.agents):
            if status.condition != self._condition[i]:
                self._condition[i] = status.condition
                self.conditions.append(ConditionChange(frame.t, i, status.condition))

    @property
    def recent_path(self) -> Array:
        """Positions of the last seconds, shape (s, N, 3), the oldest first."""
        return np.array(self._path)

    @property
    def totals(self) -> Array:
        """As History has it."""
        return self._totals.rows

    @property
    def pairs(self) -> PairSeries:
        """As History has it."""
        rows = self._pairs.rows
        return PairSeries(rows[:, 0], rows[:, 1:])

    @property
    def fates(self) -> Fates:
        """As History has it."""
        rows, n = self._late_or_lost.rows, len(self._links_to)
        t, receiver = np.repeat(rows[:, 0], n), np.tile(np.arange(n, dtype=float), len(rows))
        late, lost = rows[:, 1 : 1 + n].ravel(), rows[:, 1 + n :].ravel()
        return Fates(t, receiver, np.tile(self._links_to, len(rows)), late, lost)

    def agent(self, i: int) -> AgentSeries:
        """As History has it."""
        inputs = self._model.kinematics.inputs
        n, m, own = len(inputs), inputs[-1].stop, inputs[i]
        u = 1 + self._scalars * n + np.arange(own.start, own.stop)
        columns = [0, *(1 + k * n + i for k in range(self._scalars)), *u, *(u + m)]
        return agent_series(self._steps.rows[:, columns])
