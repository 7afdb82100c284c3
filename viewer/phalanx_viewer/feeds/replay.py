"""A recording as a feed: a cursor that one may move, and that can play."""

import threading
import time
from pathlib import Path

import msgspec
import numpy as np

from phalanx.recording.read import Recording, read
from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.recorded import RecordedRun


class Replay(RecordedRun):
    """A recording with a cursor."""

    def __init__(self, recording: Recording) -> None:
        """Raises ScenarioError if its scenario cannot be built, ValueError if it has no state."""
        super().__init__(recording)
        self.over = False
        self.t = float(self.times[0])
        self.playing = False
        self.speed = 1.0
        # A cursor that plays may be moved from another thread: without the lock, a jump between a
        # read and a write of it would be lost.
        self._cursor = threading.Lock()
        self._played_until = time.monotonic()
        self._taken: tuple[int, bool, float] | None = None

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


def open_replay(run: Path, trust: bool = False) -> Replay:
    """Read a run folder or recording file. Raises UnreadableRecordingError, ValueError."""
    return Replay(read(run, trust))
