"""Lockstep virtual time: integrate to the next event, sample, await, apply; as fast as it goes.

Events are sampling instants and the instants at which inputs take effect. The wall clock decides
nothing: an input counts from the virtual time at which it is due, however late it comes. Samples
are handed out in the order of their times, and further ones before earlier answers are there, as
long as these cannot change them; what happened is told in order, once it is known.
"""

import contextlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from phalanx.faults.commands import NO_COMMANDS, Command, CommandKind
from phalanx.faults.state import FaultState
from phalanx.plant.commands import CommandQueue
from phalanx.plant.contacts import Contacts
from phalanx.plant.events import (
    CommandObeyed,
    Event,
    InputApplied,
    InputLost,
    Sampled,
    StateReached,
)
from phalanx.plant.lookahead import Lookahead
from phalanx.plant.schedule import Schedule
from phalanx.plant.sensing import Sensing, Sight
from phalanx.plant.sensors import Sensors
from phalanx.plant.stop import SwarmBrokenError
from phalanx.plant.world import World
from phalanx.recording.write import RecordingError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.seen import SeenStates
from phalanx.wire.messages import Actuation, Sample, last_sample

Array = NDArray[np.float64]

_AT_ONCE = 8
"""How many answers may be awaited at once before the plant waits for the oldest: enough for the
cores of a host, and few to work out anew when they come."""


class Agents(Protocol):
    """The agents as the clock sees them: samples out, inputs in."""

    def send_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""

    def await_actuation(self, i: int) -> Actuation:
        """What agent i's actuator gets for its sample."""

    def take_actuation(self, i: int) -> Actuation | None:
        """The same, if it is there."""

    def pause(self, i: int, t: float) -> None:
        """Agent i's process stands still from t [s] on, once it has said all that it had to say."""

    def resume(self, i: int, t: float) -> None:
        """Agent i's process goes on at t [s]."""

    def kill(self, i: int, order: Sample) -> None:
        """Have agent i's process die of this order, once it has said all that it had to say."""

    def restart(self, i: int, t: float) -> None:
        """Have another process take the dead agent i's place at t [s]; returns when it is there."""


class Witness(Protocol):
    """Whoever is told what happened, while there is time."""

    def witness(self, event: Event) -> None:
        """Take the next event."""

    def idle(self) -> None:
        """Called when all events so far were taken."""


class _HandedOut(NamedTuple):
    """The truth at an agent's sample."""

    sight: Sight
    """Whom it sees."""
    packed: bytes
    """Their states."""
    truthful: bool
    """Whether its sensors told it these."""


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
    handed_out: dict[int, _HandedOut]
    """By agent that samples."""
    awaited: deque[_Awaited]
    """Inputs that take effect, and are not there yet."""
    reached: bool = False
    """Whether the world is there."""


class Lockstep:
    """One run in virtual time."""

    def __init__(
        self,
        rows: SafetyRows,
        world: World,
        schedule: Schedule,
        agents: Agents,
        scribe: Witness,
        faults: FaultState,
        commands: CommandQueue | None = None,
        concurrent: bool = False,
    ) -> None:
        """concurrent: whether agents compute while the plant goes on."""
        swarm = rows.swarm
        self.world = world
        self._schedule, self._agents, self._scribe = schedule, agents, scribe
        self._faults = faults
        self.sensors = Sensors(swarm)
        self._sensing, self._states = Sensing(swarm, world.motion), SeenStates(swarm)
        self._contacts = Contacts(len(swarm.members), swarm.scenario.time.latency)
        self._commands = commands or CommandQueue(NO_COMMANDS, ())
        adverse = any(group.disturbance.kind == "adverse" for group in swarm.groups)
        # A sample that sees everybody waits for everybody: to look ahead pays where most do not.
        limited = 2 * np.isfinite(self._sensing.radii).sum() > len(swarm.members)
        self._ahead: Lookahead | None = None
        if concurrent and swarm.scenario.time.lookahead and limited and not adverse:
            self._ahead = Lookahead(rows, world.motion, self._sensing.radii)
        self._now = 0.0
        """How far samples were handed out [s]; the world may be behind."""
        self._newest: dict[int, _Awaited] = {}
        """What answers each agent's last sample."""
        self._moments: deque[_Moment] = deque()
        """In order; all but the first are ahead of the world."""
        self._answers: dict[_Awaited, Actuation] = {}
        """Inputs that were needed before their moment was the first."""
        self._happened: deque[Event] = deque()

    punctuality = None
    """Virtual time is never late."""

    def run(self, duration: float) -> None:
        """Run to `duration` [s].

        Raises:
            SwarmBrokenError, RecordingError, DivergedError: an agent is dead or silent, the disk
                is full, the state is no longer finite.
        """
        self._commands.pace.restart(0.0)
        try:
            while (t := self._next_event()) < duration:
                self._event_at(t)
            self._settle()
            self._reach(duration)
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
        commands = self._commands.take(self._now, t, self._go_on)
        if commands or self._ahead is None:
            self._settle()
        self._now = t
        obeyed = [self._obey(command) for command in commands]
        handed_out = self._sample(t)
        self._moments.append(_Moment(t, obeyed, handed_out, deque(self._due(t))))
        # The agents compute now: writing down costs no time while it takes less than they do.
        self._go_on()

    def _obey(self, command: Command) -> CommandObeyed:
        """Let a command take effect."""
        i = self._faults.obey(command)
        forgotten: tuple[int, ...] = ()
        if i is None:
            return CommandObeyed(command, i)
        if self._faults.silent(i):
            self._schedule.silence(i)
        match command.kind:
            case CommandKind.KILL:
                self._agents.kill(i, self._order_to_die(i))
                forgotten = self._contacts.forget(i)
            case CommandKind.RESTART:
                self._agents.restart(i, command.t)
                self._schedule.resume(i, command.t)
            case CommandKind.FREEZE:
                self._agents.pause(i, command.t)
            case CommandKind.THAW:
                self._agents.resume(i, command.t)
                self._schedule.resume(i, command.t)
        return CommandObeyed(command, i, forgotten)

    def _order_to_die(self, i: int) -> Sample:
        """The order travels in a sample, which is not answered."""
        k, x = self._schedule.next_number(i), self._states.packed(self.world.x, (i,))
        return last_sample(i, k, self._now, x)

    def _sample(self, t: float) -> dict[int, _HandedOut]:
        """Hand a sample to every agent due at t; those due together do not hear each other."""
        due = self._schedule.sampling_at(t)
        x = self._state_at(t, due)
        handed_out = {}
        p = self._ahead.positions if self._ahead else None
        for i, whole in zip(due, self._sensing.sights(x, due, p), strict=True):
            sight = whole.without(self._faults.silent)
            since, latest = self._contacts.existing(i, t, sight.seen)
            k = self._schedule.sampled(i, t)
            self._contacts.sampled(i, k, t, sight)
            self._newest[i] = _Awaited(i, k, t, self._schedule.loses_input(i))
            told = self.sensors.told(i, k, t, x)
            packed = self._states.packed(x, sight.seen)
            handed_out[i] = _HandedOut(whole, packed, told is x)
            self._agents.send_sample(
                i,
                Sample(
                    k=k,
                    t=t,
                    seen=sight.seen,
                    x=self._states.packed(told, sight.seen),
                    since=since,
                    latest=latest,
                    hearers=sight.hearers,
                    orders=self._faults.orders(i),
                ),
            )
        return handed_out

    def _state_at(self, t: float, due: list[int]) -> Array:
        """The stacked state at t [s], of which is known at least what those due can see."""
        ahead = self._ahead
        if ahead is None:
            self.world.advance(t)
            return self.world.x
        ahead.advance(t)
        while wanted := ahead.in_question(due) or ahead.open[:-_AT_ONCE]:
            self._go_on()
            if wanted[0] in ahead.open:
                awaited = self._newest[wanted[0]]
                self._answers[awaited] = self._known(
                    awaited, self._agents.await_actuation(awaited.i)
                )
        return ahead.x

    def _due(self, t: float) -> Iterator[_Awaited]:
        """The inputs that take effect at t [s]."""
        for i in self._schedule.applying_at(t):
            self._schedule.applied(i)
            if self._ahead is not None:
                self._ahead.begin_awaiting(i)
            yield self._newest[i]

    def _settle(self) -> None:
        """Wait until all that was handed out has been answered, and has taken effect."""
        while self._moments:
            self._finish(self._moments[0], wait=True)

    def _go_on(self) -> None:
        """Let take effect what has been answered, and tell of it."""
        while self._moments and self._finish(self._moments[0], wait=False):
            pass
        self._write_down()

    def _finish(self, moment: _Moment, wait: bool) -> bool:
        """Let the first moment's inputs take effect; False if one is not there yet."""
        if not moment.reached:
            self._reach(moment.t)
            self._require_truth(moment)
            self._happened += moment.commands
            self._happened += [
                Sampled(i, moment.t, handed_out.truthful)
                for i, handed_out in moment.handed_out.items()
            ]
            moment.reached = True
        while moment.awaited:
            message = self._answer_to(moment.awaited[0], wait)
            if message is None:
                return False
            i, k, sampled, lost = moment.awaited.popleft()
            if lost:
                self._happened.append(InputLost(i, k, sampled, moment.t, message.u))
            else:
                self.world.apply(i, np.array(message.u))
                self._happened.append(InputApplied(i, k, sampled, moment.t, message.u))
        self._moments.popleft()
        return True

    def _reach(self, t: float) -> None:
        self.world.advance(t)
        self._happened.append(StateReached(t, self.world.x, self.world.take_way()))

    def _require_truth(self, moment: _Moment) -> None:
        """What was handed out ahead of the world must be what the world came to."""
        if self._ahead is None:
            return
        who, x = list(moment.handed_out), self.world.x
        for i, sight in zip(who, self._sensing.sights(x, who), strict=True):
            if (sight, self._states.packed(x, sight.seen)) != moment.handed_out[i][:2]:
                raise SwarmBrokenError(
                    f"the sample at t = {moment.t:.3f} s that was handed out ahead is not the "
                    "truth: some dynamics travel farther than their `travel` says; correct it, or "
                    "set time.lookahead = false"
                )

    def _answer_to(self, awaited: _Awaited, wait: bool) -> Actuation | None:
        if (kept := self._answers.pop(awaited, None)) is not None:
            return kept
        agents, i = self._agents, awaited.i
        message = agents.await_actuation(i) if wait else agents.take_actuation(i)
        return None if message is None else self._known(awaited, message)

    def _known(self, awaited: _Awaited, message: Actuation) -> Actuation:
        if self._ahead is not None:
            self._ahead.end_awaiting(awaited.i, None if awaited.lost else np.array(message.u))
        return message

    def _write_down(self) -> None:
        while self._happened:
            self._scribe.witness(self._happened.popleft())
        self._scribe.idle()
