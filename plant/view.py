"""What viewers see of a run: frames at a bounded rate, built only while somebody looks."""

import time
from collections import deque
from typing import Protocol

import numpy as np

from phalanx.faults.state import Faults
from phalanx.plant.commands import CommandQueue
from phalanx.plant.judge import Judge
from phalanx.plant.world import World
from phalanx.theory.rows.origin import Origin
from phalanx.wire.frames import AgentStatus, Condition, Frame, Line, LinkEvent, worse
from phalanx.wire.messages import VERSION, Input

_EVERY = 1.0 / 30.0
"""Wall time between frames [s]."""
_LINES = 30
_TROUBLES = 256
"""Most links that a frame tells of: it has to stay a small message."""


class FrameAudience(Protocol):
    """Whoever looks."""

    @property
    def present(self) -> bool:
        """Whether anybody does."""

    def show(self, frame: Frame) -> None:
        """Hand everybody a frame; lost on those who are slow."""


class View:
    """Publishes the run; it reads everything and changes nothing."""

    def __init__(
        self,
        audience: FrameAudience | None,
        judge: Judge,
        world: World,
        commands: CommandQueue,
        faults: Faults,
    ) -> None:
        self._audience, self._judge, self._world = audience, judge, world
        self._commands, self._faults = commands, faults
        agents = faults.condition
        self._last: list[Input | None] = [None for _ in agents]
        self._backups = [0 for _ in agents]
        self._log: deque[Line] = deque(maxlen=_LINES)
        self._trouble: dict[tuple[int, int], float] = {}
        self._peak = -np.inf
        self._due = 0.0
        self._pace = (time.monotonic(), 0.0, 0.0)
        """Wall time, virtual time and real-time factor when that was last measured."""

    def saw_state(self, peak: float) -> None:
        """Largest h_tot since the event before."""
        self._peak = max(self._peak, peak)

    def saw_input(self, i: int, message: Input) -> bool:
        """Agent i's input took effect. Returns whether it was the agent's first backup."""
        self._last[i] = message
        for fate in message.fates:
            link = fate.sender, i
            if fate.delay != 0.0 and (link in self._trouble or len(self._trouble) < _TROUBLES):
                self._trouble[link] = worse(self._trouble.get(link, 0.0), fate.delay)
        backup = message.origin in (Origin.BACKUP, Origin.NO_AUTHORITY)
        self._backups[i] += backup
        return backup and self._backups[i] == 1

    def say(self, t: float, text: str) -> None:
        """Add a line to the event log."""
        self._log.append(Line(t, text))

    def show(self, last: bool = False) -> None:
        """Publish a frame if one is due and somebody looks; the last one is always due."""
        now = time.monotonic()
        if self._audience is None or (now < self._due and not last):
            return
        self._due = now + _EVERY
        if self._audience.present:
            self._audience.show(self._frame(now))
        self._trouble.clear()
        self._peak = -np.inf

    def _frame(self, now: float) -> Frame:
        truth, world = self._judge.truth, self._world
        return Frame(
            version=VERSION,
            t=world.t,
            x=world.x.astype("<f8").tobytes(),
            h_tot=max(self._peak, truth.h_tot),
            worst_h=truth.worst_h_tot,
            pair=truth.largest,
            agents=tuple(self._shown(i) for i in range(len(self._last))),
            trouble=tuple(LinkEvent(*link, delay) for link, delay in self._trouble.items()),
            steps=self._judge.steps,
            real_time_factor=self._real_time_factor(now),
            assumptions=tuple(self._judge.assumptions),
            violations=tuple(truth.violations()[:8]),
            log=tuple(self._log),
            paused=self._commands.paused,
            speed=self._commands.speed,
            loss=self._faults.loss,
            delay=self._faults.delay,
        )

    def _shown(self, i: int) -> AgentStatus:
        message, condition = self._last[i], self._faults.condition[i]
        if message is None:
            return AgentStatus(Condition(condition))
        ages = [age for age in message.ages if age is not None]
        return AgentStatus(
            condition=condition,
            u=message.u,
            u_nom=message.u_nom,
            origin=message.origin,
            backups=self._backups[i],
            residual=message.residual,
            solve_time=message.solve_time,
            age=max(ages, default=None),
        )

    def _real_time_factor(self, now: float) -> float:
        wall, virtual, factor = self._pace
        if now - wall >= 0.5:
            factor = (self._world.t - virtual) / (now - wall)
            self._pace = (now, self._world.t, factor)
        return factor
