"""One agent's recorded control steps, asked by time."""

import numpy as np
from numpy.typing import NDArray

from phalanx.faults.state import Condition
from phalanx.recording.records import Step
from phalanx.theory.rows.origin import Origin
from phalanx.viewer.feeds.history import nan_if_none
from phalanx.wire.frames import AgentStatus

Array = NDArray[np.float64]


class AgentSteps:
    """The steps in the order in which their inputs were applied."""

    def __init__(self, steps: list[Step]) -> None:
        self._steps = steps
        self._applied = np.array([s.t_apply for s in steps], dtype=float)
        self._is_backup = np.array([s.origin == Origin.BACKUP for s in steps], dtype=bool)
        without_authority = [s.origin == Origin.NO_AUTHORITY for s in steps]
        self._backups = np.cumsum(self._is_backup)
        self._without_authority = np.cumsum(without_authority)

    @property
    def backups(self) -> Array:
        """When backup inputs were applied [s]."""
        return np.asarray(self._applied[self._is_backup])

    def status(self, t: float, condition: Condition) -> AgentStatus:
        """The agent at t [s]."""
        k = int(np.searchsorted(self._applied, t, side="right")) - 1
        if k < 0:
            return AgentStatus(condition)
        step = self._steps[k]
        return AgentStatus(
            condition=condition,
            u=tuple(step.u),
            u_nom=tuple(step.u_nom),
            origin=Origin(step.origin),
            backups=int(self._backups[k]),
            without_authority=int(self._without_authority[k]),
            residual=step.residual,
            solve_time=step.solve_time,
            age=step.oldest,
            certified=step.certified,
        )

    def certified(self, times: Array) -> Array:
        """How long the input in force at each time was proven safe [s]; NaN where none was."""
        known = [nan_if_none(step.certified) for step in self._steps]
        return np.array([*known, np.nan])[np.searchsorted(self._applied, times, side="right") - 1]

    def applied_within(self, after: float, until: float) -> list[Step]:
        """The steps whose input was applied after one time and not after another [s]."""
        first, last = np.searchsorted(self._applied, [after, until], side="right")
        return self._steps[first:last]

    def rows(self) -> Array:
        """As History.agent tells them, shape (s, 5 + m_i)."""
        rows = [
            [
                s.t_apply,
                backup,
                nan_if_none(s.oldest),
                s.solve_time,
                nan_if_none(s.certified),
                *s.u,
            ]
            for s, backup in zip(self._steps, self._is_backup, strict=True)
        ]
        return np.array(rows, dtype=float) if rows else np.zeros((0, 5))
