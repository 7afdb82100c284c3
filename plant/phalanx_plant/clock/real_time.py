"""Real time: virtual time follows the wall clock, and the plant waits for no agent.

A sample is taken when the plant processes it, not when it was due. An input takes effect when it is
due, or as soon as it arrives. An agent with an unanswered sample is not sampled: that tick of its
clock is missed, so samples never queue up for an agent that is too slow. After a while without an
answer the agent is sampled again, for the answer may have been lost on its way.
"""

import time
from array import array
from typing import Protocol

from msgspec import Struct

from phalanx.faults.commands import Command, ProcessChange
from phalanx.guarantee.verdict import Punctuality, percentiles
from phalanx.messages.kinds import Sample
from phalanx.theory.arrays import Array
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.judge.event_queue import EventQueue
from phalanx_plant.sampling.sampling import Processes, Sampling
from phalanx_plant.world.events import (
    CommandApplied,
    Event,
    InputApplied,
    InputLost,
    MemberLost,
    Sampled,
    StateReached,
)
from phalanx_plant.world.world import World

_PATIENCE = 1.0
"""Time without an answer after which an agent is sampled again [s of wall time]."""
_LEAD = 5e-4
"""No event is judged within this time before something is due [s of wall time]."""
_BATCH_TIME = 5e-3
"""Time for which events are prepared in one call, which may delay what is due [s of CPU time]."""
_MANY, _TOO_MANY = 70, 7_000
"""Numbers of instants above which events are judged while agents compute, and if something is due.
"""


class TimelyAgents(Processes, Protocol):
    """The agents as this clock uses them: no method waits for an agent."""

    @property
    def waiting(self) -> int:
        """Number of messages that have arrived and are not handled."""

    def send_sample(self, i: int, sample: Sample) -> None:
        """Send agent i its sample."""

    def listen(self, seconds: float) -> None:
        """Wait up to `seconds` [s of wall time] for messages, and handle those that arrived."""

    def take_reported(self, i: int) -> Array | None:
        """Return agent i's input for its newest sample, (m_i,), if its report has arrived too."""

    def take_changes(self) -> list[tuple[int, bool, str]]:
        """Return agents that were lost or came back since the last call: (i, is back, why)."""


class _PendingSample(Struct):
    """A sample whose input has not taken effect."""

    sample: Sample
    wall: float
    """Wall time at which it was sent [s]."""
    due: float
    """Virtual time at which its input takes effect [s]."""
    lost: bool
    """Whether that never reaches the actuator."""
    u: Array | None = None
    """That input, once it has arrived, shape (m_i,)."""
    late: bool = False
    """Whether it arrived after it was due; then it is due when it arrived."""


class Timekeeping:
    """Counts and times of one run, in seconds of virtual time unless said otherwise."""

    def __init__(self, periods: list[float]) -> None:
        """Begin with nothing counted; periods are Γ_i of each agent [s]."""
        self.missed = self.unanswered = self.late = 0
        self._periods = periods
        self._sampled: dict[int, float] = {}
        self._behind, self._jitter, self._latency = array("d"), array("d"), array("d")

    def sampled(self, i: int, t: float, tick: float) -> None:
        """Record that agent i took a sample at t, for a tick of its clock."""
        self._behind.append(t - tick)
        if i in self._sampled:
            self._jitter.append(abs(t - self._sampled[i] - self._periods[i]))
        self._sampled[i] = t

    def missed_tick(self, i: int) -> None:
        """Record that agent i took no sample at a tick; the next gap is no jitter."""
        self.missed += 1
        self._sampled.pop(i, None)

    def answered(self, wall: float) -> None:
        """Record the time from a sample to the arrival of its answer [s of wall time]."""
        self._latency.append(wall)

    @property
    def summary(self) -> Punctuality:
        """Counts, and percentiles of the times."""
        return Punctuality(
            samples=len(self._behind),
            missed=self.missed,
            unanswered=self.unanswered,
            late=self.late,
            measured=[
                percentiles("sample behind its clock", self._behind),
                percentiles("sampling gap off its period", self._jitter),
                percentiles("sample to input, wall time", self._latency),
            ],
        )


class RealTime:
    """One run in real time."""

    def __init__(
        self,
        world: World,
        sampling: Sampling,
        agents: TimelyAgents,
        events: EventQueue,
        commands: CommandQueue,
    ) -> None:
        self.world = world
        self.timekeeping = Timekeeping([group.clock.period for group in world.swarm.groups])
        self._sampling, self._schedule = sampling, sampling.schedule
        self._agents, self._events, self._commands = agents, events, commands
        self._pending: dict[int, _PendingSample] = {}
        """By agent."""
        self._restarting: set[int] = set()
        """Agents whose new process has not joined yet."""
        self._now = list[Event]()
        """The events of this instant."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s]. Raises RecordingError, DivergedError."""
        pace = self._commands.pace
        pace.restart(0.0)
        with self._events:
            # The recording begins at t = 0, although no agent is sampled at exactly that instant.
            self._now.append(StateReached(0.0, self.world.x, self.world.take_history()))
            try:
                while (now := pace.now()) < duration:
                    self._process_due(now)
                    next_event = min(self._schedule.next_event(), self._commands.next)
                    self._wait_until(min(next_event, duration))
                self._reach(duration)
            finally:
                self._events.add(self._now)

    @property
    def punctuality(self) -> Punctuality:
        """Delays of samples and inputs against their planned times."""
        return self.timekeeping.summary

    def _process_due(self, now: float) -> None:
        """Process all that became due up to `now` [s]."""
        self._schedule.take_applying(now)
        pending = self._pending.items()
        ready = [(p.due, i, p.u) for i, p in pending if p.u is not None and p.due <= now]
        for t, i, u in sorted(ready):
            self._reach(t)
            self._apply(i, u, t)
        commands, changes = self._commands.due(now), self._agents.take_changes()
        due = [i for i in self._schedule.sampling_at(now) if self._may_sample(i)]
        if commands or changes or due:  # events of this instant come after its state
            self._reach(now)
        for command in commands:
            self._now.append(self._apply_command(command))
        for i, back, why in changes:
            self._now.append(MemberLost(i, now, back, why))
        self._restarting -= {i for i, back, _ in changes if back}
        self._sample([i for i in due if i not in self._sampling.silent], now)
        if self._now:
            self._events.add(self._now)
            self._now = []

    def _reach(self, t: float) -> None:
        if t > self.world.t:
            self.world.advance(t)
            self._now.append(StateReached(t, self.world.x, self.world.take_history()))

    def _may_sample(self, i: int) -> bool:
        """Return whether agent i can take a sample at the current tick; else skip the tick."""
        pending = self._pending.get(i)
        if pending is None:
            return True
        if pending.u is not None or time.monotonic() < pending.wall + _PATIENCE:
            self._miss(i)
            return False
        self.timekeeping.unanswered += 1
        if i in self._restarting:
            self._agents.restart(i, self.world.t)  # the first request may have been too early
        del self._pending[i]
        return True

    def _apply(self, i: int, u: Array, t: float) -> None:
        """Let agent i's input u, shape (m_i,), take effect at t [s]."""
        pending = self._pending.pop(i)
        sample = pending.sample
        self.timekeeping.late += pending.late
        if pending.lost:
            self._now.append(InputLost(i, sample.k, sample.t, t, u))
        else:
            self.world.apply(i, u)
            self._now.append(InputApplied(i, sample.k, sample.t, t, u, sample))

    def _sample(self, due: list[int], now: float) -> None:
        x, pace = self.world.x, self._commands.pace.speed
        views = self._sampling.sensing.visible(self.world.p, due)
        for i, visible in zip(due, views, strict=True):
            self.timekeeping.sampled(i, now, self._schedule.tick(i))
            sample, truthful = self._sampling.take(i, now, x, visible, pace)
            takes_effect, lost = self._schedule.due(i), self._schedule.loses_input(i)
            self._pending[i] = _PendingSample(sample, time.monotonic(), takes_effect, lost)
            self._now.append(Sampled(i, now, truthful))
            self._agents.send_sample(i, sample)
            while self._schedule.tick(i) <= now:
                self._miss(i)

    def _miss(self, i: int) -> None:
        self.timekeeping.missed_tick(i)
        self._schedule.skip_tick(i)

    def _apply_command(self, command: Command) -> CommandApplied:
        applied = self._sampling.apply(command, self.world.x, self._agents)
        effect = command.effect
        if effect and effect.process is ProcessChange.STARTS and applied.changed is not None:
            self._restarting.add(applied.changed)
        return applied

    def _wait_until(self, until: float) -> None:
        """Judge events while there is time, and receive messages, until then [s]."""
        wait = self._commands.pace.wait
        while self._may_judge(wait(until)):
            self._events.judge_next(_BATCH_TIME)
        self._events.idle()
        self._agents.listen(wait(until))
        for i in self._computing:
            pending = self._pending[i]
            pending.u = self._agents.take_reported(i)
            if pending.u is not None:
                now = self._commands.pace.now()
                pending.late, pending.due = now > pending.due, max(now, pending.due)
                self.timekeeping.answered(time.monotonic() - pending.wall)

    def _may_judge(self, seconds: float) -> bool:
        """Return whether to judge an event, if something is due in `seconds` of wall time."""
        many = len(self._events)
        free = not self._agents.waiting and seconds > _LEAD
        return many > _TOO_MANY or (free and many > (_MANY if self._computing else 0))

    @property
    def _computing(self) -> list[int]:
        """Agents that have not answered."""
        return [i for i, pending in self._pending.items() if pending.u is None]
