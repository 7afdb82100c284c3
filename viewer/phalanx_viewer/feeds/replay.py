"""A recording as a feed: a cursor that one may move, and that can play."""

import threading
import time
from pathlib import Path

import msgspec
import numpy as np

from phalanx.arrays import Array
from phalanx.guarantee.verdict import Summary, Violation
from phalanx.recording.read import Recording, read
from phalanx.wire.messages import Frame, LogLine
from phalanx_viewer.feeds.recent_paths import SPACING, path_points
from phalanx_viewer.feeds.recorded import RecordedRun
from phalanx_viewer.scene.model import SceneModel


class Replay:
    """A recording with a cursor."""

    def __init__(self, recording: Recording) -> None:
        """Raises ScenarioError if its scenario cannot be built, ValueError if it has no state."""
        self._run = RecordedRun(recording)
        self.model: SceneModel = self._run.model
        self.summary: Summary | None = self._run.summary
        self.unfinished = recording.unfinished
        self.over = False
        self.history = self._run.history()
        self.times = self._run.times
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
    def trajectory(self) -> Array:
        """Positions at every state [m], shape (s, N, 3)."""
        return self._run.positions

    @property
    def worst_at(self) -> float:
        """When h_tot was largest [s]."""
        return self._run.worst_at

    @property
    def log(self) -> list[LogLine]:
        """The event log."""
        return self._run.log

    @property
    def violations(self) -> list[Violation]:
        """Every pair that was unsafe."""
        return list(self.summary.violations) if self.summary else []

    def seek(self, t: float) -> None:
        """Put the cursor at t [s], and stand still."""
        with self._cursor:
            self.playing = False
            self._move(t)

    def step(self, states: int) -> None:
        """Move the cursor by a number of recorded states, and stand still."""
        with self._cursor:
            self.playing = False
            index = self._run.index_at(self.t) + states
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
        shown = self._run.index_at(t), playing, speed
        if shown == self._taken:
            return None
        self._taken = shown
        return msgspec.structs.replace(
            self.frame(t),
            paused=not playing,
            speed=speed,
            real_time_factor=speed if playing else 0.0,
        )

    def frame(self, t: float) -> Frame:
        """The run as it was at t [s], standing still."""
        return self._run.frame(t)

    def recent_paths(self, t: float) -> Array:
        """Positions on the way to t [s], shape (s, N, 3)."""
        agents = len(self.model.names)
        before = SPACING * np.arange(path_points(agents))[::-1]
        # On a fixed grid of time, so that the path's points stand still while it grows.
        instants = np.floor(t / SPACING) * SPACING - before
        known = instants[instants >= self.times[0]]
        indices = [self._run.index_at(float(at)) for at in (*known, t)]
        return np.asarray(self._run.positions[indices])

    def _play_on(self) -> None:
        now = time.monotonic()
        if self.playing:
            self._move(self.t + self.speed * (now - self._played_until))
            self.playing = self.t < self.end
        self._played_until = now

    def _move(self, t: float) -> None:
        self.t = float(np.clip(t, self.times[0], self.end))


def open_replay(run: Path, trust: bool = False) -> Replay:
    """Read a run folder or recording file. Raises UnreadableRecordingError, ValueError."""
    return Replay(read(run, trust))
