"""Lockstep virtual time: integrate to the next event, sample, await, apply; as fast as it goes.

Events are sampling instants and the instants at which inputs take effect. The wall clock decides
nothing: the plant waits for every input at the virtual time at which it is due.
"""

import contextlib
from collections import deque
from typing import Protocol

import numpy as np

from phalanx.faults.commands import NO_COMMANDS, Command, CommandKind
from phalanx.faults.state import Condition, FaultState, Orders
from phalanx.plant.commands import CommandQueue
from phalanx.plant.contacts import Contacts
from phalanx.plant.events import CommandObeyed, Event, InputApplied, Sampled, StateReached
from phalanx.plant.schedule import Schedule
from phalanx.plant.sensing import Sensing
from phalanx.plant.world import World
from phalanx.recording.write import RecordingError
from phalanx.swarm.seen import SeenStates
from phalanx.swarm.swarm import Swarm
from phalanx.wire.messages import Actuation, Sample


class Agents(Protocol):
    """The agents as the clock sees them: samples out, inputs in."""

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""

    def await_actuation(self, i: int) -> Actuation:
        """What agent i's actuator gets for its sample."""


class Witness(Protocol):
    """Whoever is told what happened, while there is time."""

    def witness(self, event: Event) -> None:
        """Take the next event."""

    def idle(self) -> None:
        """Called when all events so far were taken."""


class Lockstep:
    """One run in virtual time."""

    def __init__(
        self,
        swarm: Swarm,
        world: World,
        schedule: Schedule,
        agents: Agents,
        scribe: Witness,
        faults: FaultState,
        commands: CommandQueue | None = None,
    ) -> None:
        self.world = world
        self._schedule, self._agents, self._scribe = schedule, agents, scribe
        self._faults = faults
        self._sensing, self._states = Sensing(swarm), SeenStates(swarm)
        self._contacts = Contacts(len(swarm.members), swarm.scenario.time.latency)
        self._commands = commands or CommandQueue(NO_COMMANDS, ())
        self._sampled_at: dict[int, float] = {}
        self._happened: deque[Event] = deque()

    def run(self, duration: float) -> None:
        """Run to `duration` [s].

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """
        self._commands.start()
        try:
            while (t := self._next_event()) < duration:
                self._event_at(t)
            self.world.advance(duration)
            self._reached()
            self._write_down()
        except RecordingError:
            raise
        except (Exception, KeyboardInterrupt):
            # What led to the failure is worth as much as the rest.
            with contextlib.suppress(RecordingError):
                self._write_down()
            raise

    def _next_event(self) -> float:
        return min(self._schedule.next_event(), self._commands.next)

    def _event_at(self, t: float) -> None:
        commands = self._commands.take(self.world.t, t, self._write_down)
        self.world.advance(t)
        self._reached()
        for command in commands:
            self._obey(command)
        self._sample(t)
        # The agents compute now: writing down costs no time while it takes less than they do.
        self._write_down()
        self._apply(t)

    def _reached(self) -> None:
        self._happened.append(StateReached(self.world.t, self.world.x, self.world.take_seen()))

    def _obey(self, command: Command) -> None:
        """Let a command take effect."""
        i = self._faults.obey(command)
        silenced = i if i is not None and self._faults.silent(i) else None
        self._happened.append(CommandObeyed(command, silenced))
        if silenced is not None:
            self._schedule.silence(silenced)
            if command.kind == CommandKind.KILL and not self._schedule.awaits(silenced):
                self._kill(silenced)
        elif i is not None and command.kind == CommandKind.THAW:
            self._schedule.resume(i, command.t)

    def _kill(self, i: int) -> None:
        """Tell agent i to die; the order travels in a sample that it does not answer."""
        itself = (i,)
        self._agents.send_sample(
            i,
            Sample(
                k=self._schedule.next_number(i),
                t=self.world.t,
                seen=itself,
                x=self._states.packed(self.world.x, itself),
                since=(-1,),
                latest=(-1,),
                hearers=(),
                orders=Orders(die=True),
            ),
        )

    def _sample(self, t: float) -> None:
        """Hand a sample to every agent due at t; those due together do not hear each other."""
        due = self._schedule.sampling_at(t)
        if not due:
            return
        for i, sight in zip(due, self._sensing.sights(self.world.x, due), strict=True):
            since, latest = self._contacts.existing(i, t, sight.seen)
            k = self._schedule.sampled(i, t)
            self._contacts.sampled(i, k, t, sight)
            self._sampled_at[i] = t
            self._happened.append(Sampled(i, t))
            self._agents.send_sample(
                i,
                Sample(
                    k=k,
                    t=t,
                    seen=sight.seen,
                    x=self._states.packed(self.world.x, sight.seen),
                    since=since,
                    latest=latest,
                    hearers=sight.hearers,
                    orders=self._faults.orders(i),
                ),
            )

    def _apply(self, t: float) -> None:
        """Await and apply every input that takes effect at t."""
        for i in self._schedule.applying_at(t):
            message = self._agents.await_actuation(i)
            self._schedule.applied(i)
            self.world.apply(i, np.array(message.u))
            sampled = self._sampled_at[i]
            self._happened.append(InputApplied(i, message.k, sampled, t, message.u))
            if self._faults.condition[i] == Condition.DEAD:
                self._kill(i)

    def _write_down(self) -> None:
        while self._happened:
            self._scribe.witness(self._happened.popleft())
        self._scribe.idle()
