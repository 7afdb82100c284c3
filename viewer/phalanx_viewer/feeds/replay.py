"""A recording as a feed: the frames that viewers were shown, and a cursor that moves and plays."""

import threading
import time
from pathlib import Path

import msgspec
import numpy as np

from phalanx.arrays import Array
from phalanx.curves.history import RecordedHistory
from phalanx.faults.commands import Condition, FaultState
from phalanx.guarantee.verdict import Assumption
from phalanx.recording.read import Recording, UnreadableRecordingError, read
from phalanx.recording.records import Step
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import AgentStatus, Frame, LinkEvent, LogLine, worse
from phalanx.wire.step_report import AppliedStep
from phalanx_viewer.feeds.feed import SPACING, path_points
from phalanx_viewer.scene.model import scene_model

_EVENT_SHOWN = 0.05
"""How long a lost or late broadcast stays in sight [s]."""


class Replay:
    """A recording, asked by time or by its cursor."""

    def __init__(self, recording: Recording) -> None:
        """Raises ScenarioError if its scenario cannot be built; if no state is in it, as read."""
        if not recording.states:
            raise UnreadableRecordingError(f"{recording.path}: the recording holds no state")
        self.model = scene_model(recording.scenario)
        self.history = RecordedHistory(recording, self.model.values)
        self.summary, self.unfinished = recording.summary, recording.unfinished
        self.times = self.history.times
        self.log = [LogLine(line.t, line.text) for line in recording.log]
        """The event log."""
        self.violations = list(self.summary.violations) if self.summary else []
        """Every pair that was unsafe."""
        self._commands = recording.commands
        self._worst = np.maximum.accumulate(self.history.h_tot)
        self._agents = [_AgentSteps(steps) for steps in self.history.steps]
        false = [(sender, s.t_apply) for s in recording.steps for sender, *_ in s.false]
        self._lies = [np.sort([t for who, t in false if who == name]) for name in self.model.names]
        """Times of each agent's false broadcasts [s]."""
        self._applied = np.sort([s.t_apply for s in recording.steps])
        planar = self.history.positions.shape[2] == 2
        self.trajectory = np.pad(self.history.positions, ((0, 0), (0, 0), (0, int(planar))))
        """Output points at every state [m], shape (s, N, 3)."""
        self.over = False
        self.t = float(self.times[0])
        self.playing = False
        self.speed = 1.0
        # A cursor that plays may be moved from another thread: without the lock, a jump between a
        # read and a write of it would be lost.
        self._cursor = threading.Lock()
        self._played_until = time.monotonic()
        self._taken: tuple[int, bool, float] | None = None

    @property
    def end(self) -> float:
        """Time of the last state [s]."""
        return float(self.times[-1])

    @property
    def worst_at(self) -> float:
        """When h_tot was largest [s]."""
        return float(self.times[self.history.worst])

    def index_at(self, t: float) -> int:
        """The last state that is not after t [s], by its index."""
        return max(int(np.searchsorted(self.times, t, side="right")) - 1, 0)

    def frame(self, t: float) -> Frame:
        """The run as it was at t [s], standing still."""
        index = self.index_at(t)
        x, faults = self.history.x[index], self._faults(t)
        return Frame(
            t=float(self.times[index]),
            x=x.tobytes(),
            h_tot=float(self.history.h_tot[index]),
            worst_h=float(self._worst[index]),
            pair=self.model.values.worst_pair(x),
            agents=tuple(
                a.status(t, faults.condition[i], int(np.searchsorted(lies, t, side="right")))
                for i, (a, lies) in enumerate(zip(self._agents, self._lies, strict=True))
            ),
            link_events=self._link_events(t),
            steps=int(np.searchsorted(self._applied, t, side="right")),
            real_time_factor=0.0,
            assumptions=self._failed(t),
            violations=tuple(v for v in self.violations if v.first <= t),
            log=tuple(line for line in self.log if line.t <= t),
            paused=True,
            speed=0.0,
            loss=faults.loss,
            delay=faults.delay,
        )

    def recent_paths(self, t: float) -> Array:
        """Positions on the way to t [s], shape (s, N, 3)."""
        before = SPACING * np.arange(path_points(len(self.model.names)))[::-1]
        # On a fixed grid of time, so that the path's points stand still while it grows.
        instants = np.floor(t / SPACING) * SPACING - before
        known = instants[instants >= self.times[0]]
        indices = [self.index_at(float(at)) for at in (*known, t)]
        return np.asarray(self.trajectory[indices])

    def seek(self, t: float) -> None:
        """Put the cursor at t [s], and stand still."""
        with self._cursor:
            self.playing = False
            self._move(t)

    def step(self, states: int) -> None:
        """Move the cursor by a number of recorded states, and stand still."""
        with self._cursor:
            self.playing = False
            index = self.index_at(self.t) + states
            self._move(self.times[int(np.clip(index, 0, len(self.times) - 1))])

    def play(self, playing: bool) -> None:
        """Play on, or stand still; at the end, from the start."""
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
        """What is new since the last call: the frame at the cursor, which moves if it plays."""
        with self._cursor:
            self._play_on()
            t, playing, speed = self.t, self.playing, self.speed
        shown = self.index_at(t), playing, speed
        if shown == self._taken:
            return None
        self._taken = shown
        return msgspec.structs.replace(
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
        """The assumptions that had failed by t [s]: how often is recorded of the end alone."""
        if self.summary is None:
            return ()
        found = [a for a in self.summary.assumptions if a.first is not None and a.first <= t]
        if t >= self.end:
            return tuple(found)
        # What a note adds to the assumption's own text are figures of the whole run.
        return tuple(Assumption(a.name, 1, 0, a.first, a.note.partition(";")[0]) for a in found)

    def _faults(self, t: float) -> FaultState:
        faults = FaultState(self.model.names)
        for command in self._commands:
            if command.t <= t:
                faults.obey(command)
        return faults

    def _link_events(self, t: float) -> tuple[LinkEvent, ...]:
        found: dict[tuple[int, int], float] = {}
        for receiver, agent in enumerate(self._agents):
            for step in agent.applied_within(t - _EVENT_SHOWN, t):
                for sender, _, delay in step.fates:
                    if delay != 0.0:
                        link = self.model.names.index(sender), receiver
                        found[link] = worse(found.get(link, 0.0), delay)
        return tuple(LinkEvent(*link, delay) for link, delay in found.items())


class _AgentSteps:
    """One agent's recorded control steps in the order in which their inputs were applied."""

    def __init__(self, steps: list[Step]) -> None:
        self._steps = steps
        self._applied = np.array([s.t_apply for s in steps], dtype=float)
        self._backups, self._without_authority = (
            np.cumsum([s.origin == origin for s in steps], dtype=int)
            for origin in (Origin.BACKUP, Origin.NO_AUTHORITY)
        )

    def status(self, t: float, condition: Condition, lies: int) -> AgentStatus:
        """The agent at t [s]; lies: false broadcasts that it sent so far."""
        k = int(np.searchsorted(self._applied, t, side="right")) - 1
        if k < 0:
            return AgentStatus(condition)
        return AgentStatus(
            condition=condition,
            step=msgspec.convert(self._steps[k], AppliedStep, from_attributes=True),
            backups=int(self._backups[k]),
            without_authority=int(self._without_authority[k]),
            lies=lies,
        )

    def applied_within(self, after: float, until: float) -> list[Step]:
        """The steps whose input was applied after one time and not after another [s]."""
        first, last = np.searchsorted(self._applied, [after, until], side="right")
        return self._steps[first:last]


def open_replay(run: Path, trust: bool = False) -> Replay:
    """Read a run folder or recording file. Raises UnreadableRecordingError, ValueError."""
    return Replay(read(run, trust))
