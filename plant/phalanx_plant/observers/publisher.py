"""Publish a run: frames to viewers, built only if there are any, and status to all."""

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from msgspec.structs import replace

from phalanx.faults.commands import FaultState
from phalanx.messages.frames import AgentStatus, Frame, LinkEvent, LogLine, worse
from phalanx.messages.kinds import Status
from phalanx.messages.step_report import AppliedStep
from phalanx.network.inbox import DeliveryReport, Statement
from phalanx.swarm.statements import OwnStatement
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.judge.judge import Judge, Judged
from phalanx_plant.world.events import CommandApplied, InputApplied, StateReached

_EVERY = 1.0 / 30.0
"""Wall time between frames [s]."""
_LINES = 30
_LINK_EVENTS = 256
"""Most link events in a frame, which has to stay a small message."""
_MOST_WITH_STATEMENTS = 24
"""Agents in a run whose frames have statements by radio."""
_TELL_ALL_EVERY = 1.0
"""Wall time between frames with all of them [s]."""
_STATUS_EVERY = 0.1
"""Wall time between status messages [s]."""


class FrameAudience(Protocol):
    """The viewers of a run."""

    @property
    def heard(self) -> bool:
        """True if there are any."""

    def put(self, frame: Frame) -> None:
        """Send a frame to all; slow viewers may miss it."""


class Publisher:
    """Publishes a run, from its judged events alone."""

    def __init__(
        self,
        names: tuple[str, ...],
        start: Judged,
        judge: Judge,
        commands: CommandQueue,
        publish_status: Callable[[Status], None],
        audience: FrameAudience | None = None,
    ) -> None:
        """Begin to publish a run.

        Args:
            names: of the agents.
            start: the first state.
            judge: of all events so far.
            commands: of the run, for its speed and pauses.
            publish_status: sends the run's progress to all.
            audience: receives frames.
        """
        self._judge, self._commands = judge, commands
        self._publish_status, self._audience = publish_status, audience
        # Not the clock's own, which is ahead of the judged events.
        self._faults = FaultState(names)
        self._agents = [AgentStatus() for _ in names]
        self._log: deque[LogLine] = deque(maxlen=_LINES)
        self._link_events: dict[tuple[int, int], float] = {}
        self._told: dict[tuple[int, int], OwnStatement] = {}
        """By agent and peer, the statement in the last frame that had one."""
        self._due = self._tell_all = 0.0
        self._status_due = time.monotonic()
        self._see(start)
        self.begin()

    def begin(self) -> None:
        """Count the wall time of the run from now on: all have joined."""
        self._began = time.monotonic()
        self._pace = (self._began, 0.0, 0.0)
        """Wall time, virtual time and real-time factor of its last measurement."""

    def see(self, events: Sequence[Judged]) -> None:
        """Take the next events, and publish a frame."""
        for judged in events:
            if self._audience is not None or type(judged.event) is StateReached:
                self._see(judged)
        self.show(time.monotonic())

    def reach(self, t: float, x: Array) -> None:
        """Take the stacked state x at t [s], without a frame."""
        self._t, self._x = t, x

    def _see(self, judged: Judged) -> None:
        event = judged.event
        for notice in judged.notices:
            self._log.append(LogLine(notice.t, notice.text))
        for fate, finding in judged.received:
            if finding.false:
                sender = self._agents[fate.sender]
                self._agents[fate.sender] = replace(sender, lies=sender.lies + 1)
        match event:
            case StateReached():
                self._t, self._x = event.t, event.x
                self._peak, self._pair = judged.peak, judged.pair
            case CommandApplied():
                self._faults.apply(event.command)
            case InputApplied() if numbers := judged.step:
                fates = [fate for fate, _ in judged.received]
                self._applied(event.i, AppliedStep(**numbers), fates)

    def _applied(self, i: int, step: AppliedStep, fates: list[DeliveryReport]) -> None:
        """Update agent i's status, and the links on which it received the broadcasts in `fates`."""
        before = self._agents[i]
        self._agents[i] = replace(
            before,
            step=step,
            backups=before.backups + (step.origin == Origin.BACKUP),
            without_authority=before.without_authority + (step.origin == Origin.NO_AUTHORITY),
        )
        for fate in fates:
            link = fate.sender, i
            delays = self._link_events
            if fate.delay != 0.0 and (link in delays or len(delays) < _LINK_EVENTS):
                delays[link] = worse(delays.get(link, 0.0), fate.delay)

    def idle(self, now: float) -> None:
        """Publish a frame and the status if they are due at this wall time [s]."""
        self.show(now)
        if now < self._status_due:
            return
        self._status_due = now + _STATUS_EVERY
        findings = self._judge.findings()
        self._publish_status(
            Status(
                t=self._t,
                real_time_factor=self._t / max(now - self._began, 1e-9),
                worst_h=findings.worst_h,
                steps=findings.steps,
                backups=findings.origins[Origin.BACKUP],
            )
        )

    def show(self, now: float) -> None:
        """Publish a frame if there are viewers, and one is due at this wall time [s]."""
        if self._audience is None or now < self._due:
            return
        self._due = now + _EVERY
        if self._audience.heard:
            self._audience.put(self._frame(time.monotonic()))
        self._link_events.clear()

    def _frame(self, now: float) -> Frame:
        findings = self._judge.findings()
        lasting_first = sorted(findings.violations, key=lambda v: v.end is not None)
        return Frame(
            t=self._t,
            x=self._x.astype("<f8").tobytes(),
            h_tot=self._peak[0],
            h=self._peak[1],
            worst_h=findings.worst_h,
            pair=self._pair,
            turned=tuple(sorted(self._faults.turned)),
            agents=tuple(
                replace(agent, condition=condition)
                for agent, condition in zip(self._agents, self._faults.condition, strict=True)
            ),
            link_events=tuple(LinkEvent(*at, delay) for at, delay in self._link_events.items()),
            steps=findings.steps,
            real_time_factor=self._real_time_factor(now),
            assumptions=tuple(findings.assumptions),
            violations=tuple(lasting_first[:8]),
            log=tuple(self._log),
            paused=self._commands.pace.paused,
            speed=self._commands.pace.speed,
            loss=self._faults.loss,
            delay=self._faults.delay,
            statements=tuple(self._statements(now)),
        )

    def _statements(self, now: float) -> Iterator[tuple[int, Statement]]:
        """Yield agents, and statements that came to them; a lost frame is made up for later."""
        if now >= self._tell_all:
            self._told, self._tell_all = {}, now + _TELL_ALL_EVERY
        if len(self._agents) > _MOST_WITH_STATEMENTS:
            return
        for i, known in self._judge.statements.items():
            for l, said in known.items():
                if self._told.get((i, l)) is not said:
                    self._told[i, l] = said
                    yield i, Statement(
                        sender=l, k=said.k, t_apply=said.t_apply, u=said.u, t=said.t, x=said.x,
                        z=said.z,
                    )  # fmt: skip

    def _real_time_factor(self, now: float) -> float:
        wall, virtual, factor = self._pace
        if now - wall >= 0.5:
            factor = (self._t - virtual) / (now - wall)
            self._pace = (now, self._t, factor)
        return factor
