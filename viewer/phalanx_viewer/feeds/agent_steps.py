"""One agent's recorded control steps, asked by time."""

import msgspec
import numpy as np

from phalanx.faults.commands import Condition
from phalanx.recording.records import Step
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import AgentStatus
from phalanx.wire.step_report import AppliedStep, numbers_of
from phalanx_viewer.feeds.history import EMPTY_CODES, AgentSeries, agent_series, series_width


class AgentSteps:
    """The steps in the order in which their inputs were applied."""

    def __init__(self, steps: list[Step]) -> None:
        self._steps = steps
        self._applied = np.array([s.t_apply for s in steps], dtype=float)
        self._is_backup = np.array([s.origin == Origin.BACKUP for s in steps], dtype=bool)
        without_authority = [s.origin == Origin.NO_AUTHORITY for s in steps]
        self._backups = np.cumsum(self._is_backup)
        self._without_authority = np.cumsum(without_authority)

    def status(self, t: float, condition: Condition, lies: int = 0) -> AgentStatus:
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

    def series(self, inputs: int) -> AgentSeries:
        """All of them, of an agent with so many inputs."""
        rows = [
            [
                s.t_apply,
                EMPTY_CODES.get(s.origin, 0.0),
                *numbers_of(s),
                *s.u,
                *(s.u_nom or [None] * inputs),
            ]
            for s in self._steps
        ]
        # NumPy makes NaN of None.
        return agent_series(np.array(rows, dtype=float).reshape(-1, series_width(inputs)))
