"""Lockstep virtual time: integrate to the next event, sample, await inputs, apply them.

Events are sampling instants and the instants at which inputs take effect. The wall clock decides
nothing: an input counts from the virtual time at which it is due, however late it arrives. Samples
are sent in the order of their times, and further ones before earlier answers have arrived, as long
as these cannot change them. Events are judged in order, once they are known.
"""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from typing import Protocol

from msgspec import Struct

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
    Sampled,
    StateReached,
    SwarmBrokenError,
)
from phalanx_plant.world.world import World


class Agents(Processes, Protocol):
    """The agents as this clock uses them.

    `pause` and `kill` first wait for the agent's pending messages, and `restart` returns when the
    new process has joined.
    """

    def send_sample(self, i: int, sample: Sample) -> None:
        """Send agent i its sample."""

    def await_input(self, i: int) -> Array:
        """Wait for agent i's input for its sample, shape (m_i,)."""

    def take_input(self, i: int) -> Array | None:
        """Return the same if it has arrived, else None."""


class _PendingInput(Struct, frozen=True):
    """The input that answers sample k of agent i."""

    i: int
    k: int
    t_sample: float
    """[s]"""
    lost: bool
    """Whether it never reaches the actuator."""


class _Instant(Struct):
    """All that is due at one instant; complete once its pending inputs have arrived."""

    t: float
    """[s]"""
    commands: list[CommandApplied]
    samples: list[Sampled]
    unknown: list[int]
    """Agents whose states were not known when the samples were sent."""
    pending: deque[_PendingInput]
    """Inputs that take effect, and have not arrived."""
    events: list[Event] = []
    """Those so far; empty until the world has reached this instant."""


class Sequential:
    """It waits for all answers, so an input is known as soon as it takes effect."""

    sequential = True
    """Whether all samples are answered before virtual time goes on."""

    def __init__(self, world: World) -> None:
        self._world = world

    @property
    def unknown(self) -> list[int]:
        """Agents whose states are unknown, as their inputs are pending; the oldest first."""
        return []

    def begin_unknown(self, i: int) -> None:
        """Let agent i's pending input take effect, whatever it is."""

    def end_unknown(self, i: int, u: Array | None) -> None:
        """Set agent i's pending input to u, shape (m_i,).

        None: it was lost, and the actuator holds the input before it.
        """
        if u is not None:
            self._world.apply(i, u)

    def required(self, sampling: Sequence[int]) -> list[int]:
        """Return agents whose inputs must be known before those in `sampling` are sampled."""
        return []

    def advance(self, until: float) -> None:
        """Integrate to `until` [s]. Raises DivergedError."""
        self._world.advance(until)

    def reach(self, until: float) -> None:
        """Bring the world to `until` [s]. Raises DivergedError."""
        self._world.advance(until)


class Lockstep:
    """One run in virtual time."""

    def __init__(
        self,
        world: World,
        sampling: Sampling,
        agents: Agents,
        events: EventQueue,
        commands: CommandQueue,
        synchronization: Callable[[World], Sequential] = Sequential,
    ) -> None:
        """Begin at t = 0; the synchronization decides which answers to wait for."""
        self.world = world
        self._sampling, self._schedule = sampling, sampling.schedule
        self._agents, self._events, self._commands = agents, events, commands
        self._synchronization = synchronization(world)
        self._now = 0.0
        """Time up to which samples were sent [s]; the world may be behind."""
        self._newest: dict[int, _PendingInput] = {}
        """By agent, the input that answers its last sample."""
        self._instants: deque[_Instant] = deque()
        """Incomplete ones, in order; all but the first are ahead of the world."""
        self._early: dict[_PendingInput, Array] = {}
        """Inputs that were needed before their instant was the first."""

    punctuality = None
    """Virtual time is never late."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s]. Raises as Clock.run does."""
        for _ in self.instants(duration):
            pass

    @property
    def next_instant(self) -> float:
        """Time of the next event, or scheduled command [s]; infinite if there is none."""
        return min(self._schedule.next_event(), self._commands.next)

    def instants(self, duration: float) -> Generator[float, None, None]:
        """Run to `duration` [s], and yield the time of each instant [s] when it has been handled.

        With agents that answer at once it is complete then: the world is there, with its inputs.
        Closing the iterator judges what is left. Raises as Clock.run does.
        """
        self._commands.pace.restart(0.0)
        with self._events:
            try:
                while (t := self.next_instant) < duration:
                    self._event_at(t)
                    yield t
                self._complete(wait=True)
                self._events.add([self._reach(duration)])
            finally:
                if self._instants:  # after an error: its events count as far as they are known
                    self._events.add(self._instants[0].events)

    def catch_up(self) -> None:
        """Apply the inputs that have arrived, and judge all events. Raises as Clock.run does."""
        self._complete(wait=False)
        self._events.judge_all()

    def _event_at(self, t: float) -> None:
        commands = self._commands.wait_until(t, self._now, self.catch_up)
        if commands or self._synchronization.sequential:
            self._complete(wait=True)
        self._now = t
        applied = [self._sampling.apply(c, self.world.x, self._agents) for c in commands]
        samples = self._sample(t)
        unknown = self._synchronization.unknown
        self._instants.append(_Instant(t, applied, samples, unknown, self._take_pending(t)))
        # The agents compute now: judging costs no time while it takes less than they do.
        self._apply_and_judge()

    def _sample(self, t: float) -> list[Sampled]:
        """Send a sample to every agent due at t [s]."""
        due = self._schedule.sampling_at(t)
        self._advance(t, due)
        state, samples = self.world.integration, list[Sampled]()
        for i, visible in zip(due, self._sampling.sensing.visible(state.p, due), strict=True):
            sample, truthful = self._sampling.take(i, t, state.x, visible)
            samples.append(Sampled(i, t, truthful))
            self._newest[i] = _PendingInput(i, sample.k, t, self._schedule.loses_input(i))
            self._agents.send_sample(i, sample)
        return samples

    def _advance(self, t: float, due: list[int]) -> None:
        """Integrate to t [s], and wait until all states that those due can see are known."""
        synchronization = self._synchronization
        synchronization.advance(t)
        while required := synchronization.required(due):
            self._apply_and_judge()
            if required[0] in synchronization.unknown:
                pending = self._newest[required[0]]
                u = self._agents.await_input(pending.i)
                self._early[pending] = self._settle(pending, u)

    def _take_pending(self, t: float) -> deque[_PendingInput]:
        """The inputs that take effect at t [s], in order."""
        pending = deque[_PendingInput]()
        for i in self._schedule.take_applying(t):
            self._synchronization.begin_unknown(i)
            pending.append(self._newest[i])
        return pending

    def _apply_and_judge(self) -> None:
        """Apply the inputs that have arrived, and judge events in full batches."""
        self._complete(wait=False)
        self._events.judge_batches()

    def _complete(self, wait: bool) -> None:
        """Apply the inputs of instants in order: all, or up to one that has not arrived."""
        while self._instants and self._complete_first(self._instants[0], wait):
            pass

    def _complete_first(self, instant: _Instant, wait: bool) -> bool:
        """Apply the first instant's inputs; return False if one has not arrived."""
        events = instant.events
        if not events:
            events += [self._reach(instant.t), *instant.commands, *instant.samples]
            if instant.unknown:
                self._require_unseen(instant)
        while instant.pending:
            u = self._answer_to(instant.pending[0], wait)
            if u is None:
                return False
            answer = instant.pending.popleft()
            kind = InputLost if answer.lost else InputApplied
            events.append(kind(answer.i, answer.k, answer.t_sample, instant.t, u))
        self._events.add(events)
        self._instants.popleft()
        return True

    def _reach(self, t: float) -> StateReached:
        self._synchronization.reach(t)
        return StateReached(t, self.world.x, self.world.take_history())

    def _require_unseen(self, instant: _Instant) -> None:
        """Raise SwarmBrokenError if an agent saw one whose state was not known at that time."""
        sees, p = self._sampling.sensing.sees, self.world.p
        if any(sees(p, s.i, instant.unknown) for s in instant.samples):
            raise SwarmBrokenError(
                f"the sample at t = {instant.t:.3f} s that was sent ahead is not the truth: some "
                "dynamics travel farther than their `travel` returns; correct it, or set "
                "time.lookahead = false"
            )

    def _answer_to(self, pending: _PendingInput, wait: bool) -> Array | None:
        if self._early and (early := self._early.pop(pending, None)) is not None:
            return early
        agents, i = self._agents, pending.i
        u = agents.await_input(i) if wait else agents.take_input(i)
        return None if u is None else self._settle(pending, u)

    def _settle(self, pending: _PendingInput, u: Array) -> Array:
        self._synchronization.end_unknown(pending.i, None if pending.lost else u)
        return u
