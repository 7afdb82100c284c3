"""A recording as a feed: the same frames that a live run shows, at the time one asks for."""

import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.faults.state import Faults
from phalanx.guarantee.verdict import Summary
from phalanx.recording.read import Recording, read
from phalanx.recording.records import Step
from phalanx.theory.rows.origin import Origin
from phalanx.viewer.feeds.history import TRAIL_EVERY, History, Table, nan_if_none, trail_length
from phalanx.viewer.scene.model import SceneModel, scene_model
from phalanx.wire.frames import AgentStatus, Frame, Line, LinkEvent, worse
from phalanx.wire.messages import VERSION

Array = NDArray[np.float64]

_BACKUPS = (Origin.BACKUP, Origin.NO_AUTHORITY)
_TROUBLE_SHOWN = 0.05
"""How long a lost or late broadcast stays in sight [s]."""


class Mark(NamedTuple):
    """A moment worth jumping to."""

    t: float
    text: str


class Replay:
    """A recording with a cursor that can play."""

    def __init__(self, recording: Recording) -> None:
        """Raises ScenarioError if its scenario cannot be built, ValueError if it has no state."""
        if not recording.states:
            raise ValueError(f"{recording.path}: the recording holds no state")
        self.cast: SceneModel = scene_model(recording.scenario)
        self.summary: Summary | None = recording.summary
        self.over = False
        self.times = recording.times
        self.playing = False
        self.speed = 1.0
        self.t = float(self.times[0])
        self._x, self._h_tot = recording.x, recording.h_tot
        self._worst = np.maximum.accumulate(self._h_tot)
        self._log, self._controls = recording.log, recording.commands
        self._steps = [[s for s in recording.steps if s.agent == n] for n in self.cast.names]
        self._applied = [np.array([s.t_apply for s in steps]) for steps in self._steps]
        self._backups = [
            np.cumsum([s.origin in _BACKUPS for s in steps], dtype=int) for steps in self._steps
        ]
        self._all_applied = np.sort(np.concatenate(self._applied))
        self.history = self._past()
        self._wall = time.monotonic()
        self._shown = -1

    @property
    def end(self) -> float:
        """Time of the last state [s]."""
        return float(self.times[-1])

    @property
    def worst_at(self) -> float:
        """When h_tot was largest [s]."""
        return float(self.times[int(np.argmax(self._h_tot))])

    @property
    def marks(self) -> list[Mark]:
        """The worst moment, the first backup, and every line of the log."""
        first = [s.t_apply for steps in self._steps for s in steps if s.origin in _BACKUPS]
        found = [Mark(self.worst_at, f"worst moment, h_tot = {self._h_tot.max():.4g}")]
        found += [Mark(min(first), "first backup")] if first else []
        return found + [Mark(line.t, line.text) for line in self._log]

    def seek(self, t: float) -> None:
        """Put the cursor at t [s]."""
        self.t = float(np.clip(t, self.times[0], self.end))

    def step(self, states: int) -> None:
        """Move the cursor by a number of recorded states, and stand still."""
        self.playing = False
        self.seek(self.times[int(np.clip(self._index() + states, 0, len(self.times) - 1))])

    def play(self, playing: bool) -> None:
        """Play on, or stand still; at the end, from the start."""
        if playing and self.t >= self.end:
            self.seek(self.times[0])
        self.playing = playing
        self._wall = time.monotonic()

    def take(self) -> Frame | None:
        """The frame at the cursor, unless it was taken before; playing moves the cursor."""
        now = time.monotonic()
        if self.playing:
            self.seek(self.t + self.speed * (now - self._wall))
            self.playing = self.t < self.end
        self._wall = now
        index = self._index()
        if index == self._shown:
            return None
        self._shown = index
        return self.frame(self.t)

    def past(self, t: float) -> Array:
        """Positions on the way to t [s], shape (s, N, 3)."""
        back = TRAIL_EVERY * np.arange(trail_length(len(self._steps)))[::-1]
        instants = (np.floor(t / TRAIL_EVERY) * TRAIL_EVERY) - back
        indices = np.searchsorted(self.times, instants[instants >= self.times[0]], side="right") - 1
        return np.asarray(self._positions[[*indices, self._index_at(t)]])

    def frame(self, t: float) -> Frame:
        """The run as it was at t [s]."""
        index = self._index_at(t)
        x = self._x[index]
        faults = Faults(self.cast.names)
        for control in self._controls:
            if control.t <= t:
                faults.obey(control)
        assumptions = self.summary.assumptions if self.summary else []
        violations = self.summary.violations if self.summary else []
        return Frame(
            version=VERSION,
            t=float(self.times[index]),
            x=x.tobytes(),
            h_tot=float(self._h_tot[index]),
            worst_h=float(self._worst[index]),
            pair=self.cast.largest(x),
            agents=tuple(self._agent(i, t, faults) for i in range(len(self._steps))),
            trouble=self._trouble(t),
            steps=int(np.searchsorted(self._all_applied, t, side="right")),
            real_time_factor=self.speed if self.playing else 0.0,
            assumptions=tuple(a for a in assumptions if a.first is not None and a.first <= t),
            violations=tuple(v for v in violations if v.first <= t),
            log=tuple(Line(line.t, line.text) for line in self._log if line.t <= t),
            paused=not self.playing,
            speed=self.speed,
            loss=faults.loss,
            delay=faults.delay,
        )

    def _index(self) -> int:
        return self._index_at(self.t)

    def _index_at(self, t: float) -> int:
        return max(int(np.searchsorted(self.times, t, side="right")) - 1, 0)

    def _agent(self, i: int, t: float, faults: Faults) -> AgentStatus:
        k = int(np.searchsorted(self._applied[i], t, side="right")) - 1
        if k < 0:
            return AgentStatus(faults.condition[i])
        step = self._steps[i][k]
        return AgentStatus(
            condition=faults.condition[i],
            u=tuple(step.u),
            u_nom=tuple(step.u_nom),
            origin=Origin(step.origin),
            backups=int(self._backups[i][k]),
            residual=step.residual,
            solve_time=step.solve_time,
            age=_oldest(step),
        )

    def _trouble(self, t: float) -> tuple[LinkEvent, ...]:
        found: dict[tuple[int, int], float] = {}
        for i, (steps, applied) in enumerate(zip(self._steps, self._applied, strict=True)):
            first, last = np.searchsorted(applied, [t - _TROUBLE_SHOWN, t], side="right")
            for step in steps[first:last]:
                for sender, _, delay in step.fates:
                    link = self.cast.names.index(sender), i
                    if delay != 0.0:
                        found[link] = worse(found.get(link, 0.0), delay)
        return tuple(LinkEvent(*link, delay) for link, delay in found.items())

    def _past(self) -> History:
        places = [self.cast.places(x) for x in self._x]
        distances = [self.cast.smallest_distance(p.positions) for p in places]
        psi = [self.cast.higher_psi(x) for x in self._x]
        swarm = np.column_stack([self.times, self._h_tot, distances, np.array(psi)])
        self._positions = np.array([p.positions for p in places])
        agents = [_rows(steps) for steps in self._steps]
        return History(Table(0, swarm), agents.__getitem__)


def open_replay(run: Path) -> Replay:
    """Read a run folder or recording file. Raises UnreadableRecordingError, ValueError."""
    return Replay(read(run))


def _rows(steps: list[Step]) -> Array:
    rows = [
        [s.t_apply, s.origin in _BACKUPS, nan_if_none(_oldest(s)), s.solve_time, *s.u]
        for s in steps
    ]
    return np.array(rows, dtype=float) if rows else np.zeros((0, 4))


def _oldest(step: Step) -> float | None:
    return max((age for age in step.ages if age is not None), default=None)
