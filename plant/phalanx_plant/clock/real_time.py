"""Real time: virtual time is tied to the wall clock, and nobody waits for anybody.

A sample is taken when the plant comes to it, not when it was due. An input takes effect when it is
due, or as soon as it is here. An agent that still owes an answer is not sampled: that tick of its
clock is missed, so samples never pile up before an agent that is too slow. Whoever has not answered
for a while is sampled again, for the answer may have been lost on its way.
"""

import time
from array import array
from typing import NamedTuple, Protocol

from phalanx.arrays import Array
from phalanx.faults.commands import Command, ProcessChange
from phalanx.guarantee.verdict import Punctuality, percentiles
from phalanx.wire.messages import Sample
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.judge.backlog import Backlog
from phalanx_plant.sampling.sampling import Processes, Sampling
from phalanx_plant.world.events import (
    CommandObeyed,
    InputApplied,
    InputLost,
    InstantOver,
    MemberLost,
    Sampled,
    StateReached,
)
from phalanx_plant.world.world import World

_PATIENCE = 1.0
"""After so long without an answer an agent is sampled again [s of wall time]."""
_MOMENT = 5e-4
"""In less than this before something is due, nothing is judged [s of wall time]."""
_MUCH, _MOST = 200, 20_000
"""So many events are judged even while agents compute, and even if something is due."""


class TimelyAgents(Processes, Protocol):
    """The agents as the wall clock sees them: nobody waits for what they still have to say."""

    @property
    def waiting(self) -> int:
        """How much has come that was not handled yet."""

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""

    def listen(self, seconds: float) -> None:
        """Handle what comes, for so long [s of wall time], or until something has come."""

    def take_reported(self, i: int) -> Array | None:
        """Agent i's input for its newest sample, shape (m_i,), if its report has come too."""

    def take_changes(self) -> list[tuple[int, bool]]:
        """Who is not to be reached any more, and who is back, since last asked: (i, is back)."""


class _Asked(NamedTuple):
    """A sample that was handed out."""

    sample: Sample
    wall: float
    """By the wall clock [s]."""
    due: float
    """When its answer is to take effect [s]."""
    lost: bool
    """Whether it never comes to the actuator."""


class _Answer(NamedTuple):
    """An input that is here."""

    takes_effect: float
    """[s]"""
    u: Array
    """Native input, shape (m_i,)."""


class Timekeeping:
    """Counts and times of one run, in seconds of virtual time unless said otherwise."""

    def __init__(self, periods: list[float]) -> None:
        """periods: Γ_i of each agent [s]."""
        self.missed = self.unanswered = self.late = 0
        self._periods = periods
        self._sampled: dict[int, float] = {}
        self._behind, self._jitter, self._latency = array("d"), array("d"), array("d")

    def sampled(self, i: int, t: float, tick: float) -> None:
        """Agent i took a sample at t, for a tick of its clock."""
        self._behind.append(t - tick)
        if i in self._sampled:
            self._jitter.append(abs(t - self._sampled[i] - self._periods[i]))
        self._sampled[i] = t

    def missed_tick(self, i: int) -> None:
        """Agent i took no sample at a tick of its clock; the next gap is no jitter."""
        self.missed += 1
        self._sampled.pop(i, None)

    def answered(self, wall: float) -> None:
        """An answer took so long, from the plant and back [s of wall time]."""
        self._latency.append(wall)

    @property
    def summary(self) -> Punctuality:
        """All of it."""
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
    """One run by the wall clock."""

    def __init__(
        self,
        world: World,
        sampling: Sampling,
        agents: TimelyAgents,
        happened: Backlog,
        commands: CommandQueue,
    ) -> None:
        self.world = world
        self.timekeeping = Timekeeping([group.clock.period for group in world.swarm.groups])
        self._sampling, self._schedule = sampling, sampling.schedule
        self._agents, self._happened, self._commands = agents, happened, commands
        self._asked: dict[int, _Asked] = {}
        """Whose input has not taken effect yet."""
        self._answers: dict[int, _Answer] = {}
        """By agent, what is here of them."""
        self._returning: set[int] = set()
        """Whose place another process is to take, and has not yet."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s]. Raises RecordingError, DivergedError."""
        pace = self._commands.pace
        pace.restart(0.0)
        with self._happened:
            # The recording begins at the start, although nobody is sampled at that instant.
            self._happened.add(StateReached(0.0, self.world.x, self.world.take_way()))
            while (now := pace.now()) < duration:
                self._be_at(now)
                self._rest(min(self._next_event(), duration))
            self._reach(duration)

    @property
    def punctuality(self) -> Punctuality:
        """How the run kept its times."""
        return self.timekeeping.summary

    def _next_event(self) -> float:
        return min(self._schedule.next_event(), self._commands.next)

    def _be_at(self, now: float) -> None:
        """Do all that is due at `now` [s], or was since the world was last looked at."""
        for i in self._schedule.applying_at(now):
            self._schedule.applied(i)
        ready = [(a.takes_effect, i) for i, a in self._answers.items() if a.takes_effect <= now]
        for t, i in sorted(ready):
            self._reach(t)
            self._apply(i, t)
        commands, changes = self._commands.come(now), self._agents.take_changes()
        due = [i for i in self._schedule.sampling_at(now) if self._may_sample(i)]
        if commands or changes or due:
            self._reach(now)
        for command in commands:
            self._happened.add(self._obey(command))
        for i, back in changes:
            self._happened.add(MemberLost(i, now, back))
        self._returning -= {i for i, back in changes if back}
        self._sample([i for i in due if not self._sampling.silent(i)], now)
        if ready or commands or changes or due:
            self._happened.add(InstantOver(self.world.t))

    def _reach(self, t: float) -> None:
        if t > self.world.t:
            self.world.advance(t)
            self._happened.add(StateReached(t, self.world.x, self.world.take_way()))

    def _may_sample(self, i: int) -> bool:
        """Whether agent i can take a sample at the tick that has come; else the tick goes by."""
        asked = self._asked.get(i)
        if asked is None:
            return True
        if i in self._answers or time.monotonic() < asked.wall + _PATIENCE:
            self._miss(i)
            return False
        self.timekeeping.unanswered += 1
        if i in self._returning:
            self._agents.restart(i, self.world.t)  # it may have been asked for too early
        del self._asked[i]
        return True

    def _apply(self, i: int, t: float) -> None:
        """Let agent i's input take effect at t [s]."""
        asked, answer = self._asked.pop(i), self._answers.pop(i)
        self.timekeeping.late += t > asked.due
        if asked.lost:
            self._happened.add(InputLost(i, asked.sample.k, asked.sample.t, t, answer.u))
        else:
            self.world.apply(i, answer.u)
            k, sampled, x = asked.sample.k, asked.sample.t, self.world.x
            self._happened.add(InputApplied(i, k, sampled, t, answer.u, x, asked.sample))

    def _sample(self, due: list[int], now: float) -> None:
        x, pace = self.world.x, self._commands.pace.speed
        for i, sight in zip(due, self._sampling.sensing.sights(self.world.p, due), strict=True):
            self.timekeeping.sampled(i, now, self._schedule.tick(i))
            taken = self._sampling.take(i, now, x, sight, pace)
            takes_effect, lost = self._schedule.due(i), self._schedule.loses_input(i)
            self._asked[i] = _Asked(taken.sample, time.monotonic(), takes_effect, lost)
            self._happened.add(Sampled(i, now, taken.truthful))
            self._agents.send_sample(i, taken.sample)
            while self._schedule.tick(i) <= now:
                self._miss(i)

    def _miss(self, i: int) -> None:
        self.timekeeping.missed_tick(i)
        self._schedule.pass_over(i)

    def _obey(self, command: Command) -> CommandObeyed:
        obeyed = self._sampling.obey(command, self.world.x, self._agents)
        effect = command.effect
        if effect and effect.process is ProcessChange.STARTS and obeyed.changed is not None:
            self._returning.add(obeyed.changed)
        return obeyed

    def _rest(self, until: float) -> None:
        """Take in what comes until then [s], and write down what happened while there is time."""
        wait = self._commands.pace.wait
        while self._has_time(wait(until)):
            self._happened.judge_one()
        self._happened.idle()
        self._agents.listen(wait(until))
        for i in self._computing:
            u, asked = self._agents.take_reported(i), self._asked[i]
            if u is not None:
                now = self._commands.pace.now()
                self._answers[i] = _Answer(max(now, asked.due), u)
                self.timekeeping.answered(time.monotonic() - asked.wall)

    def _has_time(self, seconds: float) -> bool:
        """Whether something is to be judged, so long before the next is due [s]."""
        many = len(self._happened)
        free = not self._agents.waiting and seconds > _MOMENT
        return many > _MOST or (free and many > (_MUCH if self._computing else 0))

    @property
    def _computing(self) -> list[int]:
        """Who owes an answer."""
        return [i for i in self._asked if i not in self._answers]
