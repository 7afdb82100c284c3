"""The columns of a run that are kept for its metrics, in place of a recording."""

import numpy as np

from phalanx.guarantee.verdict import Deadlock
from phalanx.recording.columns import Inputs, States, Track
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx_plant.judge.event_columns import Columns


class DueStates:
    """The states that are recorded: those at least a recording step after one another."""

    def __init__(self, swarm: Swarm) -> None:
        self._every, self._end, self._due = swarm.time.recording_step, swarm.scenario.duration, 0.0

    def of(self, times: Array) -> list[int]:
        """Return which of the next states, at these times [s], are recorded."""
        return [row for row, t in enumerate(times.tolist()) if self.take(t)]

    def take(self, t: float) -> bool:
        """Return whether the next state, at t [s], is recorded."""
        if t < min(self._due, self._end):
            return False
        self._due = t + self._every
        return True


class TrackKeeper:
    """Keeps the columns of a run that its metrics take."""

    def __init__(self, swarm: Swarm) -> None:
        self._due, self._states, self._inputs = DueStates(swarm), list[States](), list[Inputs]()

    def keep(self, columns: Columns) -> None:
        """Take the next events."""
        rows = self._due.of(columns.states.t)
        self._states.append(States._make(column[rows] for column in columns.states))
        self._inputs.append(columns.inputs)

    def track(self, deadlocks: list[Deadlock] | None) -> Track:
        """Return the columns of all events; deadlocks: that the plant saw."""
        inputs = Inputs(*map(np.concatenate, zip(*self._inputs, strict=True)))
        before = np.cumsum([0, *(len(part.binding) for part in self._inputs)])
        ends = [part.bindings + n for part, n in zip(self._inputs, before, strict=False)]
        states = States(*map(np.concatenate, zip(*self._states, strict=True)))
        return Track(states, inputs._replace(bindings=np.concatenate(ends)), deadlocks)
