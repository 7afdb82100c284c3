"""A recording as a feed: the frames that viewers were shown, and a cursor that moves and plays."""

import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace

from phalanx.faults.commands import Condition, FaultState
from phalanx.guarantee.verdict import Assumption, Violation
from phalanx.messages.frames import AgentStatus, Frame, LinkEvent, LogLine, worse
from phalanx.messages.step_report import AppliedStep
from phalanx.recording.curves.beliefs import RecordedBeliefs
from phalanx.recording.curves.history import AgentSeries, RecordedHistory
from phalanx.recording.curves.series import Series
from phalanx.recording.read import Recording, UnreadableRecordingError, read, steps_by_agent
from phalanx.recording.records import Level, Step
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from phalanx_viewer.feeds.live_history import SPACING, path_points
from phalanx_viewer.scene.legend import BELIEFS, Mark, marks_in, marks_of
from phalanx_viewer.scene.model import scene_model

_EVENT_SHOWN = 0.05
"""Time for which a lost or late broadcast stays visible [s]."""


class Replay:
    """A recording, read at a time or at its cursor.

    It holds arrays of what is shown, not the recording: records of many agents need much memory.
    """

    def __init__(self, recording: Recording) -> None:
        """Raises ScenarioError if the scenario cannot be built, and the error of read if no state
        was recorded.
        """
        if not recording.states:
            raise UnreadableRecordingError(f"{recording.path}: the recording holds no state")
        self.model = scene_model(recording.scenario)
        self.history = RecordedHistory(recording, self.model.values)
        self.path = recording.path
        self.summary, self.unfinished = recording.summary, recording.unfinished
        self.times = self.history.times
        self.log = [LogLine(line.t, line.text) for line in recording.log]
        self.violations = list(self.summary.violations) if self.summary else []
        """Every pair that was unsafe."""
        swarm = self.model.swarm
        self.radio = RecordedBeliefs(recording, swarm) if swarm.by_radio else None
        """What agents knew of one another; None where they see one another."""
        self.effects: Mapping[int, Series] = {}
        """By agent, the network effect over time [%], if that was computed."""
        self._commands = recording.commands
        self._worst = np.maximum.accumulate(self.history.h)
        self._crossings = [line for line in recording.log if line.pair]
        self._agents = [
            _AgentSteps(steps, self.history.agent(i), self.model.names)
            for i, steps in enumerate(steps_by_agent(recording).values())
        ]
        false = [(sender, s.t_apply) for s in recording.steps for sender, *_ in s.false]
        self._lies = [
            np.sort([t for sender, t in false if sender == name]) for name in self.model.names
        ]
        """Times of each agent's false broadcasts [s]."""
        self._applied = np.sort([s.t_apply for s in recording.steps])
        self.over = False
        """True once a live run's plant has left: never here."""
        self.t = float(self.times[0])
        self.playing = False
        self.speed = 1.0
        # A cursor that plays may be moved from another thread: without the lock, a jump between a
        # read and a write of it would be lost.
        self._cursor = threading.Lock()
        self._played_until = time.monotonic()
        self._last: tuple[int, bool, float] | None = None
        self.marks = self._marks()
        """Marks of the scene that the run has at some time."""

    def _marks(self) -> set[Mark]:
        delays = np.concatenate([agent.every_delay for agent in self._agents])
        links = {Mark.LATE: (delays > 0.0).any(), Mark.LOST: (delays < 0.0).any()}
        marks = marks_of(self.model) | marks_in(self.frame(self.end))
        marks |= {mark for mark, holds in links.items() if holds}
        if any(change.condition.silent for change in self.history.conditions):
            marks.add(Mark.SILENT)
        return marks | (BELIEFS if self.radio else set())

    @property
    def end(self) -> float:
        """Time of the last state [s]."""
        return float(self.times[-1])

    @property
    def worst_at(self) -> float:
        """Time at which the h of a pair with a normal agent was largest [s]."""
        return float(self.times[self.history.worst])

    def index_at(self, t: float) -> int:
        """Index of the last state that is not after t [s]."""
        return max(int(np.searchsorted(self.times, t, side="right")) - 1, 0)

    def frame(self, t: float) -> Frame:
        """The run as it was at t [s], paused."""
        index, faults = self.index_at(t), FaultState(self.model.names)
        for command in self._commands:
            if command.t <= t:
                faults.apply(command)
        x = self.history.x[index]
        return Frame(
            t=float(self.times[index]),
            x=x.tobytes(),
            h_tot=float(self.history.h_tot[index]),
            h=float(self.history.h[index]),
            worst_h=float(self._worst[index]),
            pair=self.model.values.worst_pair(x, faults.turned),
            turned=tuple(sorted(faults.turned)),
            agents=tuple(
                a.status(t, faults.condition[i], int(np.searchsorted(lies, t, side="right")))
                for i, (a, lies) in enumerate(zip(self._agents, self._lies, strict=True))
            ),
            link_events=self._link_events(t),
            steps=int(np.searchsorted(self._applied, t, side="right")),
            real_time_factor=0.0,
            assumptions=self._failed(t),
            violations=tuple(self._until(t, v) for v in self.violations if v.first <= t),
            log=tuple(line for line in self.log if line.t <= t),
            paused=True,
            speed=0.0,
            loss=faults.loss,
            delay=faults.delay,
        )

    def _until(self, t: float, violation: Violation) -> Violation:
        """A pair's excursions up to t [s]; their depth and duration are only known at the end."""
        crossings = [
            line for line in self._crossings if line.pair == violation.pair and line.t <= t
        ]
        begins = [line.t for line in crossings if line.level is Level.ERROR]
        begins = [begin for begin in begins if begin <= violation.begin] or [violation.first]
        ends = [line.t for line in crossings if line.level is Level.INFO] + [
            violation.end or np.inf
        ]
        end = min((end for end in ends if begins[-1] < end <= t), default=None)
        return replace(violation, count=len(begins), begin=begins[-1], end=end)

    def recent_paths(self, t: float) -> Array:
        """Positions up to t [s], shape (s, N, 3), the oldest first."""
        before = SPACING * np.arange(path_points(len(self.model.names)))[::-1]
        # On a fixed grid of time, so that the path's points stand still while it grows.
        instants = np.floor(t / SPACING) * SPACING - before
        past = instants[instants >= self.times[0]]
        indices = [self.index_at(float(at)) for at in (*past, t)]
        return np.asarray(self.history.trajectory[indices])

    def seek(self, t: float) -> None:
        """Move the cursor to t [s], and pause."""
        with self._cursor:
            self.playing = False
            self._move(t)

    def step(self, states: int) -> None:
        """Move the cursor by a number of recorded states, and pause."""
        with self._cursor:
            self.playing = False
            index = self.index_at(self.t) + states
            self._move(self.times[int(np.clip(index, 0, len(self.times) - 1))])

    def play(self, playing: bool) -> None:
        """Play on, or pause; at the end, play from the start."""
        with self._cursor:
            if playing and self.t >= self.end:
                self._move(self.times[0])
            self.playing = playing
            self._played_until = time.monotonic()

    def set_speed(self, factor: float) -> None:
        """Play at a multiple of real time."""
        with self._cursor:
            self._play_on()
            self.speed = float(np.clip(factor, 0.01, 100.0))

    def take(self) -> Frame | None:
        """Return the frame at the cursor, which moves if it plays; None if nothing is new."""
        with self._cursor:
            self._play_on()
            t, playing, speed = self.t, self.playing, self.speed
        state = self.index_at(t), playing, speed
        if state == self._last:
            return None
        self._last = state
        return replace(
            self.frame(t),
            paused=not playing,
            speed=speed,
            real_time_factor=speed if playing else 0.0,
        )

    def _play_on(self) -> None:
        now = time.monotonic()
        if self.playing:
            self._move(self.t + self.speed * (now - self._played_until))
            self.playing = self.t < self.end
        self._played_until = now

    def _move(self, t: float) -> None:
        self.t = float(np.clip(t, self.times[0], self.end))

    def _failed(self, t: float) -> tuple[Assumption, ...]:
        """Assumptions that had failed by t [s]; how often is only known at the end."""
        every = self.summary.assumptions if self.summary else ()
        failed = [a for a in every if a.first is not None and a.first <= t]
        if t >= self.end:
            return tuple(failed)
        # A note adds figures of the whole run to the assumption's own text.
        return tuple(Assumption(a.name, 1, 0, a.first, a.note.partition(";")[0]) for a in failed)

    def _link_events(self, t: float) -> tuple[LinkEvent, ...]:
        delays: dict[tuple[int, int], float] = {}
        for receiver, agent in enumerate(self._agents):
            for sender, delay in agent.delays(t - _EVENT_SHOWN, t):
                link = int(sender), receiver
                delays[link] = worse(delays.get(link, 0.0), delay)
        return tuple(LinkEvent(*link, delay) for link, delay in delays.items())


class _AgentSteps:
    """One agent's recorded control steps in the order in which their inputs were applied."""

    def __init__(self, steps: list[Step], series: AgentSeries, names: tuple[str, ...]) -> None:
        """names: of all agents."""
        self._series, self._origins = series, [s.origin for s in steps]
        self._bindings = [s.binding for s in steps]
        self._backups, self._without_authority = (
            np.cumsum([s.origin == origin for s in steps], dtype=int)
            for origin in (Origin.BACKUP, Origin.NO_AUTHORITY)
        )
        index = {name: float(i) for i, name in enumerate(names)}
        late = [(s.t_apply, index[sender], d) for s in steps for sender, _, d in s.fates if d]
        self._late = np.array(late).reshape(-1, 3)
        """t_apply [s], sender, delay [s] of the broadcasts to it that were delayed or lost."""

    def status(self, t: float, condition: Condition, lies: int) -> AgentStatus:
        """The agent at t [s]; lies: false broadcasts that it had sent."""
        series = self._series
        k = int(np.searchsorted(series.t, t, side="right")) - 1
        if k < 0:
            return AgentStatus(condition)
        numbers = {name: float(values[k]) for name, values in series.numbers.items()}
        u_nom = () if np.isnan(series.u_nom[k]).any() else tuple(series.u_nom[k].tolist())
        fields: dict[str, Any] = {n: None if np.isnan(v) else v for n, v in numbers.items()}
        fields |= {"origin": self._origins[k], "binding": self._bindings[k]}
        fields |= {"u": tuple(series.u[k].tolist()), "u_nom": u_nom}
        return AgentStatus(
            condition=condition,
            step=AppliedStep(**fields),
            backups=int(self._backups[k]),
            without_authority=int(self._without_authority[k]),
            lies=lies,
        )

    @property
    def every_delay(self) -> Array:
        """Delays of all late and lost broadcasts to it [s], shape (b,); negative: lost."""
        return self._late[:, 2]

    def delays(self, after: float, until: float) -> list[list[float]]:
        """[sender, delay] of late and lost broadcasts, by steps applied in (after, until] [s]."""
        first, last = np.searchsorted(self._late[:, 0], [after, until], side="right")
        delays: list[list[float]] = self._late[first:last, 1:].tolist()
        return delays


def open_replay(run: Path, trust: bool = False) -> Replay:
    """Read a run folder or recording file. Raises UnreadableRecordingError, ValueError."""
    return Replay(read(run, trust))
