"""The past of a live run, gathered frame by frame."""

from bisect import bisect_right
from collections.abc import Sequence
from itertools import chain

import numpy as np

from phalanx.faults.commands import Condition
from phalanx.guarantee.verdict import Violation
from phalanx.messages.frames import AgentStatus, Frame, LogLine
from phalanx.messages.step_report import QUANTITIES, AppliedStep, numbers_of
from phalanx.recording.curves import history
from phalanx.recording.curves.beliefs import Beliefs, News
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from phalanx_viewer.scene.legend import BELIEFS, marks_in, marks_of
from phalanx_viewer.scene.model import SceneModel

SPACING = 0.2
"""Between two points of a recent path [s]."""
_MOST_POINTS, _MOST_OF_ALL_AGENTS = 60, 3000
_FIRST_CAPACITY, _MOST_ROWS = 256, 4096
"""Rows of a series: a plot has no more than 400 points."""
_MOST_FRAMES, _MOST_STATUSES = 2000, 40_000
"""Frames to look back at, and statuses of agents in them together."""
_PAIR_STATES = 200
"""Most states of a run at which h of every pair is computed."""


def path_points(agents: int) -> int:
    """Number of points of each recent path: every update sends all of them, in one message."""
    return max(4, min(_MOST_POINTS, _MOST_OF_ALL_AGENTS // agents))


class _TimeSeries:
    """Rows of numbers, time [s] first, appended one by one; of too many, every two become one."""

    def __init__(self, choices: Sequence[int] | Array) -> None:
        """choices: for each number 1, -1 or 0: of two rows it is the largest, smallest or last."""
        self._choices = np.array(choices)
        self._rows, self._count = np.zeros((_FIRST_CAPACITY, len(choices))), 0
        self._of_row, self._of_last = 1, 1
        """Rows that were appended for each one here, and for the last."""

    def append(self, row: Array | list[float]) -> None:
        if self._of_last < self._of_row:
            last = self._count - 1
            self._rows[last], self._of_last = self._merged(self._rows[last], row), self._of_last + 1
            return
        if self._count == _MOST_ROWS:
            self._count //= 2
            self._rows[: self._count] = self._merged(self._rows[::2], self._rows[1::2])
            self._of_row *= 2
        elif self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count], self._of_last = row, 1
        self._count += 1

    def _merged(self, before: Array, after: Array | list[float]) -> Array:
        """Two rows, or two arrays of rows, as one; a number that is known goes before NaN."""
        largest, smallest = np.fmax(before, after), np.fmin(before, after)
        merged: Array = np.choose(self._choices + 1, [smallest, after, largest])
        return merged

    @property
    def rows(self) -> Array:
        """All rows so far, shape (s, width)."""
        return self._rows[: self._count]


class LiveBeliefs(Beliefs):
    """Beliefs by radio, from the statements that frames bring."""

    def __init__(self, model: SceneModel) -> None:
        super().__init__(model.swarm)
        self._newest = {
            i: {n.peer: n.said for n in news if n.said} for i, news in self.news.items()
        }
        self._spacing = model.scenario.duration / _MOST_FRAMES

    def add(self, frame: Frame) -> None:
        """Add a frame's news; a process that is dead has forgotten what it knew."""
        for i, known in self._newest.items():
            if frame.agents[i].condition is Condition.DEAD:
                self.news[i] += [News(frame.t, l, None) for l in known]
                known.clear()
            elif frame.t >= (self.sampled[i] or [-np.inf])[-1] + self._spacing:
                self.sampled[i].append(frame.t)
                self._used[i].append({l for l, said in known.items() if said.k >= 0})
        for i, said in frame.statements:
            known, l = self._newest.get(i, {}), said.sender
            newer = l not in known or said.k > known[l].k
            if newer and frame.agents[i].condition is not Condition.DEAD:
                known[l] = said
                self.news[i].append(News(frame.t, l, said))


class LiveHistory(history.History):
    """The past in the frames that were added, and the agents' recent paths."""

    def __init__(self, model: SceneModel) -> None:
        n, m = len(model.names), model.kinematics.inputs[-1].stop
        self._model = model
        self._totals = _TimeSeries([1, 1, 1, -1, *(1 for _ in model.values.psi_levels)])
        self._worst = np.inf
        self._path = _TimeSeries([1, *np.zeros(3 * n, dtype=int)])
        self._path_due = -np.inf
        self._frames: list[Frame] = []
        self._added, self._every = 0, 1
        self._most_frames = 2 * (min(_MOST_FRAMES, _MOST_STATUSES // n) // 2)
        self._scalars = history.series_width(0) - 1
        """Numbers of AgentSeries that each agent has after t, before its inputs."""
        plotted = [1, *(-1 if q.safe[0] is not None else 1 for q in QUANTITIES.values())]
        self._steps = _TimeSeries([1, *np.repeat(plotted, n), *np.zeros(2 * m, dtype=int)])
        """t; each of these numbers of every agent; all u; all u_nom. NaN before its first step."""
        unknown = [(np.nan,) * (part.stop - part.start) for part in model.kinematics.inputs]
        self._no_steps = [
            AppliedStep(origin=Origin.QP, residual=None, solve_time=np.nan, u=u, u_nom=u)
            for u in unknown
        ]
        pairs = len(model.swarm.safe_set.pairs)
        self._pairs = _TimeSeries([1] * (1 + pairs))
        self._pairs_due = -np.inf
        self._pairs_spacing = model.scenario.duration / history.pair_states(pairs, _PAIR_STATES)
        self._late_or_lost = _TimeSeries([1] * (1 + 2 * n))
        """t; the number of links to each agent that were late since the row before, and lost."""
        self._links_to = np.array([len(model.swarm.heard_by(i)) for i in range(n)], dtype=float)
        self._empty = np.zeros((2, n))
        self._condition = [Condition.FINE] * n
        self.beliefs = LiveBeliefs(model) if model.swarm.by_radio else None
        self.broadcasts = np.recarray(0, history.BROADCAST)
        self.conditions: list[history.ConditionChange] = []
        self.log: list[LogLine] = []
        self.marks = marks_of(model) | (BELIEFS if self.beliefs else set())
        """Marks of the scene that the run had so far."""
        self.violations: dict[str, Violation] = {}
        """By pair, from the last frame that named it: a frame holds the worst ones alone."""

    def add(self, frame: Frame) -> None:
        """Append a frame."""
        if self._added % self._every == 0:  # of too many, every other one goes
            if len(self._frames) == self._most_frames:
                del self._frames[1::2]
                self._every *= 2
            self._frames.append(frame)
        self._added += 1
        x = np.frombuffer(frame.x, dtype="<f8")
        positions = self._model.kinematics.poses(x).positions
        distance = history.smallest_distance(self._model.swarm, positions)
        psi = self._model.values.higher_psi(x)
        # Between two frames h may have been larger than at both.
        h = frame.worst_h if frame.worst_h > self._worst else frame.h
        self._worst = frame.worst_h
        self._totals.append([frame.t, frame.h_tot, h, distance, *psi])
        if frame.t >= self._path_due:
            self._path_due = frame.t + SPACING
            self._path.append([frame.t, *positions.ravel()])
        if frame.t >= self._pairs_due:
            self._pairs_due = frame.t + self._pairs_spacing
            every_h = self._model.values.every_h(x, frame.turned)
            self._pairs.append(np.append(frame.t, every_h))
        if not self._model.crowded:
            self._add_fates(frame)
        self._add_steps(frame.t, frame.agents)
        self._add_conditions(frame)
        if self.beliefs:
            self.beliefs.add(frame)
        self.marks |= marks_in(frame)
        self.violations.update((violation.pair, violation) for violation in frame.violations)
        # A frame holds the last lines alone, most of which came before.
        self.log += [line for line in frame.log if line not in self.log[-len(frame.log) :]]

    def _add_steps(self, t: float, agents: tuple[AgentStatus, ...]) -> None:
        # A frame holds each agent's last step alone. Its counts show whether K_i was empty in any
        # step since the frame before; that is plotted at the later frame.
        empty = np.array([(s.backups, s.without_authority) for s in agents], dtype=float).T
        more = empty > self._empty
        code = history.EMPTY_CODES
        codes = np.where(more[1], code[Origin.NO_AUTHORITY], code[Origin.BACKUP] * more[0])
        steps = [a.step or none for a, none in zip(agents, self._no_steps, strict=True)]
        # NumPy makes NaN of None.
        numbers = np.array([numbers_of(s) for s in steps], dtype=float).T.ravel()
        u = [*chain.from_iterable(s.u for s in steps)]
        u_nom = [*chain.from_iterable(s.u_nom for s in steps)]
        self._steps.append(np.concatenate([[t], codes, numbers, u, u_nom]))
        self._empty = empty

    def _add_fates(self, frame: Frame) -> None:
        # A frame holds the worst event of each link since the frame before.
        n, events = len(self._links_to), frame.link_events
        late = np.bincount([e.receiver for e in events if e.delay >= 0.0], minlength=n)
        lost = np.bincount([e.receiver for e in events if e.delay < 0.0], minlength=n)
        self._late_or_lost.append([frame.t, *late, *lost])

    def _add_conditions(self, frame: Frame) -> None:
        for i, status in enumerate(frame.agents):
            if status.condition != self._condition[i]:
                self._condition[i] = status.condition
                self.conditions.append(history.ConditionChange(frame.t, i, status.condition))

    def frame_at(self, t: float, step: int = 0) -> Frame | None:
        """The last frame not after t [s], or so many frames later; None: the present."""
        k = bisect_right(self._frames, t, key=lambda frame: frame.t) - 1 + step
        if k >= len(self._frames) or (step == 0 and t >= self.totals[-1, 0]):
            return None
        return self._frames[max(k, 0)]

    def recent_path(self, t: float) -> Array:
        """Positions of the last seconds until t [s], shape (s, N, 3), the oldest first."""
        rows, n = self._path.rows, len(self._links_to)
        end = int(np.searchsorted(rows[:, 0], t, side="right"))
        return rows[max(end - path_points(n), 0) : end, 1:].reshape(-1, n, 3)

    @property
    def totals(self) -> Array:
        return self._totals.rows

    @property
    def pairs(self) -> history.PairSeries:
        rows = self._pairs.rows
        return history.PairSeries(rows[:, 0], rows[:, 1:])

    @property
    def fates(self) -> history.Fates:
        rows, n = self._late_or_lost.rows, len(self._links_to)
        t, receiver = np.repeat(rows[:, 0], n), np.tile(np.arange(n, dtype=float), len(rows))
        late, lost = rows[:, 1 : 1 + n].ravel(), rows[:, 1 + n :].ravel()
        return history.Fates(t, receiver, np.tile(self._links_to, len(rows)), late, lost)

    def agent(self, i: int) -> history.AgentSeries:
        inputs = self._model.kinematics.inputs
        n, m, part = len(inputs), inputs[-1].stop, inputs[i]
        u = 1 + self._scalars * n + np.arange(part.start, part.stop)
        columns = [0, *(1 + k * n + i for k in range(self._scalars)), *u, *(u + m)]
        rows = self._steps.rows[:, columns]
        return history.agent_series(rows[~np.isnan(rows[:, history.series_width(0)])])
