"""Lockstep virtual time: integrate to the next event, sample, await, apply; as fast as it goes.

Events are sampling instants and the instants at which inputs take effect. The wall clock decides
nothing: an input counts from the virtual time at which it is due, however late it comes. Samples
are handed out in the order of their times, and further ones before earlier answers are there, as
long as these cannot change them; what happened is judged in order, once it is known.
"""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from phalanx.arrays import Array
from phalanx.wire.messages import Sample
from phalanx_plant.clock.commands import CommandQueue
from phalanx_plant.clock.lookahead import Synchronization
from phalanx_plant.judge.backlog import Backlog
from phalanx_plant.sampling.sampling import Processes, Sampling, Taken
from phalanx_plant.world.events import (
    CommandObeyed,
    InputApplied,
    InputLost,
    InstantOver,
    Sampled,
    StateReached,
    SwarmBrokenError,
)
from phalanx_plant.world.world import World


class Agents(Processes, Protocol):
    """The agents as the clock sees them: samples out, inputs in.

    Whoever is to stand still or to die first says all that it had to say, and `restart` returns
    when the new process is there.
    """

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""

    def await_input(self, i: int) -> Array:
        """The input that agent i's actuator gets for its sample, shape (m_i,)."""

    def take_input(self, i: int) -> Array | None:
        """The same, if it is there."""


class _Awaited(NamedTuple):
    """An input that answers sample k of agent i."""

    i: int
    k: int
    sampled: float
    """[s]"""
    lost: bool
    """Whether it never comes to the actuator."""


@dataclass
class _Moment:
    """What is due at one instant; over once every input that takes effect then is there."""

    t: float
    """[s]"""
    commands: list[CommandObeyed]
    handed_out: dict[int, Taken]
    """By agent that samples."""
    unknown: list[int]
    """Agents whose states were not known when samples were handed out."""
    awaited: deque[_Awaited]
    """Inputs that take effect, and are not there yet."""
    reached: bool = False
    """Whether the world is there."""


class Lockstep:
    """One run in virtual time."""

    def __init__(
        self,
        world: World,
        sampling: Sampling,
        agents: Agents,
        happened: Backlog,
        commands: CommandQueue,
        synchronization: Callable[[World], Synchronization] = Synchronization,
    ) -> None:
        """synchronization: decides whose answers are waited for."""
        self.world = world
        self._sampling, self._schedule = sampling, sampling.schedule
        self._agents, self._happened, self._commands = agents, happened, commands
        self._synchronization = synchronization(world)
        self._now = 0.0
        """How far samples were handed out [s]; the world may be behind."""
        self._newest: dict[int, _Awaited] = {}
        """What answers each agent's last sample."""
        self._moments: deque[_Moment] = deque()
        """In order; all but the first are ahead of the world."""
        self._answers: dict[_Awaited, Array] = {}
        """Inputs that were needed before their moment was the first."""

    punctuality = None
    """Virtual time is never late."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s].

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """
        self._commands.pace.restart(0.0)
        with self._happened:
            while (t := self._next_event()) < duration:
                self._event_at(t)
            self._settle()
            self._reach(duration)

    def _next_event(self) -> float:
        return min(self._schedule.next_event(), self._commands.next)

    def _event_at(self, t: float) -> None:
        commands = self._commands.take(self._now, t, self._catch_up)
        if commands or self._synchronization.sequential:
            self._settle()
        self._now = t
        obeyed = [self._sampling.obey(c, self.world.x, self._agents) for c in commands]
        handed_out = self._sample(t)
        unknown = self._synchronization.open
        self._moments.append(_Moment(t, obeyed, handed_out, unknown, deque(self._due(t))))
        # The agents compute now: writing down costs no time while it takes less than they do.
        self._go_on()

    def _sample(self, t: float) -> dict[int, Taken]:
        """Hand a sample to every agent due at t."""
        due = self._schedule.sampling_at(t)
        self._advance(t, due)
        state, handed_out = self.world.integration, {}
        for i, sight in zip(due, self._sampling.sensing.sights(state.p, due), strict=True):
            taken = handed_out[i] = self._sampling.take(i, t, state.x, sight)
            self._newest[i] = _Awaited(i, taken.sample.k, t, self._schedule.loses_input(i))
            self._agents.send_sample(i, taken.sample)
        return handed_out

    def _advance(self, t: float, due: list[int]) -> None:
        """Integrate to t [s], until at least is known what those due can see."""
        synchronization = self._synchronization
        synchronization.advance(t)
        while wanted := synchronization.in_question(due):
            self._go_on()
            if wanted[0] in synchronization.open:
                awaited = self._newest[wanted[0]]
                self._answers[awaited] = self._known(awaited, self._agents.await_input(awaited.i))

    def _due(self, t: float) -> Iterator[_Awaited]:
        """The inputs that take effect at t [s]."""
        for i in self._schedule.applying_at(t):
            self._schedule.applied(i)
            self._synchronization.begin_awaiting(i)
            yield self._newest[i]

    def _settle(self) -> None:
        """Wait until all that was handed out has been answered, and has taken effect."""
        while self._moments:
            self._finish(self._moments[0], wait=True)

    def _go_on(self) -> None:
        """Let take effect what has been answered, and have most events judged."""
        self._apply_answers()
        self._happened.judge_most()

    def _catch_up(self) -> None:
        """Let take effect what has been answered, and have all events judged."""
        self._apply_answers()
        self._happened.judge_all()

    def _apply_answers(self) -> None:
        while self._moments and self._finish(self._moments[0], wait=False):
            pass

    def _finish(self, moment: _Moment, wait: bool) -> bool:
        """Let the first moment's inputs take effect; False if one is not there yet."""
        if not moment.reached:
            self._reach(moment.t)
            self._require_truth(moment)
            for obeyed in moment.commands:
                self._happened.add(obeyed)
            for i, taken in moment.handed_out.items():
                self._happened.add(Sampled(i, moment.t, taken.truthful))
            moment.reached = True
        while moment.awaited:
            u = self._answer_to(moment.awaited[0], wait)
            if u is None:
                return False
            i, k, sampled, lost = moment.awaited.popleft()
            if lost:
                self._happened.add(InputLost(i, k, sampled, moment.t, u))
            else:
                self._happened.add(InputApplied(i, k, sampled, moment.t, u, self.world.x))
        self._happened.add(InstantOver(moment.t))
        self._moments.popleft()
        return True

    def _reach(self, t: float) -> None:
        self._synchronization.reach(t)
        self._happened.add(StateReached(t, self.world.x, self.world.take_way()))

    def _require_truth(self, moment: _Moment) -> None:
        """Whoever was not known when samples were handed out must have been out of sight."""
        sees, p = self._sampling.sensing.sees, self.world.p
        if moment.unknown and any(sees(p, i, moment.unknown) for i in moment.handed_out):
            raise SwarmBrokenError(
                f"the sample at t = {moment.t:.3f} s that was handed out ahead is not the truth: "
                "some dynamics travel farther than their `travel` says; correct it, or set "
                "time.lookahead = false"
            )

    def _answer_to(self, awaited: _Awaited, wait: bool) -> Array | None:
        if (kept := self._answers.pop(awaited, None)) is not None:
            return kept
        agents, i = self._agents, awaited.i
        u = agents.await_input(i) if wait else agents.take_input(i)
        return None if u is None else self._known(awaited, u)

    def _known(self, awaited: _Awaited, u: Array) -> Array:
        self._synchronization.end_awaiting(awaited.i, None if awaited.lost else u)
        return u
