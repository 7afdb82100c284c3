"""What viewers see of a run: frames at a bounded rate, built only while somebody looks."""

import time
from collections import deque
from collections.abc import Iterable
from typing import Protocol

import numpy as np

from phalanx.arrays import Array
from phalanx.faults.commands import Command, FaultState
from phalanx.network.inbox import Fate
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import AgentStatus, Frame, LinkEvent, LogLine, worse
from phalanx.wire.step_report import AppliedStep
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.events.events import StateReached
from phalanx_plant.judge.judge import Judge

_EVERY = 1.0 / 30.0
"""Wall time between frames [s]."""
_LINES = 30
_LINK_EVENTS = 256
"""Most links that a frame tells of: it has to stay a small message."""


class FrameAudience(Protocol):
    """Whoever looks."""

    @property
    def present(self) -> bool:
        """Whether anybody does."""

    def show(self, frame: Frame) -> None:
        """Hand everybody a frame; lost on those who are slow."""


class FramePublisher:
    """Publishes the run; it reads everything and changes nothing."""

    def __init__(
        self,
        audience: FrameAudience | None,
        judge: Judge,
        commands: CommandQueue,
        names: tuple[str, ...],
        start: Array,
    ) -> None:
        """names: of all agents. start: x(0), shape (n̄,)."""
        self._audience, self._judge, self._commands = audience, judge, commands
        # Its own: those who obey are ahead of what has been told.
        self._faults = FaultState(names)
        self._t, self._x, self._settled = 0.0, start, True
        self._last: list[AppliedStep | None] = [None for _ in names]
        self._backups = [0 for _ in names]
        self._without_authority = [0 for _ in names]
        self._lies = [0 for _ in names]
        self._log: deque[LogLine] = deque(maxlen=_LINES)
        self._link_events: dict[tuple[int, int], float] = {}
        self._peak = -np.inf
        self._due = 0.0
        self._pace = (time.monotonic(), 0.0, 0.0)
        """Wall time, virtual time and real-time factor when that was last measured."""

    def saw_state(self, event: StateReached, peak: float) -> None:
        """The world at an event, and the largest h_tot since the one before."""
        self._t, self._x, self._settled = event.t, event.x, False
        self._peak = max(self._peak, peak)

    def saw_step(self, i: int, step: AppliedStep, fates: Iterable[Fate]) -> None:
        """Agent i's input took effect; fates are those of broadcasts that it reported."""
        self._last[i] = step
        self._backups[i] += step.origin == Origin.BACKUP
        self._without_authority[i] += step.origin == Origin.NO_AUTHORITY
        for fate in fates:
            link = fate.sender, i
            known = link in self._link_events
            if fate.delay != 0.0 and (known or len(self._link_events) < _LINK_EVENTS):
                self._link_events[link] = worse(self._link_events.get(link, 0.0), fate.delay)

    def saw_command(self, command: Command) -> None:
        """A command was obeyed."""
        self._faults.obey(command)

    def saw_lie(self, i: int) -> None:
        """A broadcast of agent i's was false."""
        self._lies[i] += 1

    def settled(self) -> None:
        """All that happens at the last state's time was seen; show it if a frame is due."""
        self._settled = True
        self.show()

    def say(self, t: float, text: str) -> None:
        """Add a line to the event log."""
        self._log.append(LogLine(t, text))

    def show(self, last: bool = False) -> None:
        """Publish a frame if one is due and somebody looks; the last one is always due.

        None is due in the middle of an instant, some of whose inputs were seen and some not.
        """
        now = time.monotonic()
        due = self._settled and now >= self._due
        if self._audience is None or not (due or last):
            return
        self._due = now + _EVERY
        if self._audience.present:
            self._audience.show(self._frame(now))
        self._link_events.clear()
        self._peak = -np.inf

    def _frame(self, now: float) -> Frame:
        extremes = self._judge.extremes
        return Frame(
            t=self._t,
            x=self._x.astype("<f8").tobytes(),
            h_tot=max(self._peak, extremes.h_tot),
            worst_h=extremes.worst_h_tot,
            pair=extremes.largest,
            agents=tuple(self._status(i) for i in range(len(self._last))),
            link_events=tuple(LinkEvent(*at, delay) for at, delay in self._link_events.items()),
            steps=self._judge.steps,
            real_time_factor=self._real_time_factor(now),
            assumptions=tuple(self._judge.assumptions),
            violations=tuple(extremes.violations()[:8]),
            log=tuple(self._log),
            paused=self._commands.pace.paused,
            speed=self._commands.pace.speed,
            loss=self._faults.loss,
            delay=self._faults.delay,
        )

    def _status(self, i: int) -> AgentStatus:
        return AgentStatus(
            condition=self._faults.condition[i],
            step=self._last[i],
            backups=self._backups[i],
            without_authority=self._without_authority[i],
            lies=self._lies[i],
        )

    def _real_time_factor(self, now: float) -> float:
        wall, virtual, factor = self._pace
        if now - wall >= 0.5:
            factor = (self._t - virtual) / (now - wall)
            self._pace = (now, self._t, factor)
        return factor
