"""Scheduled and live commands: when they take effect, and the speed of virtual time."""

import logging
import math
import queue
import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterable
from operator import attrgetter

import msgspec
import numpy as np

from phalanx.faults.commands import Command, CommandKind, CommandPolicy, refusal, require_valid
from phalanx.faults.fault import Occurrence
from phalanx.messages.frames import CommandMessage
from phalanx.messages.seal import Malformed, Refusals, Sealer
from phalanx.swarm.swarm import Swarm

log = logging.getLogger("phalanx.plant")

_BEGIN = attrgetter("begin")

_POLL = 0.03
"""While waiting, period of showing the run and of checking whether it was stopped [s]."""


class Pace:
    """Virtual time as a function of wall time."""

    def __init__(self, speed: float) -> None:
        """Go at most `speed` seconds of virtual time per second; 0: as fast as possible."""
        self.speed = speed
        self._until = math.inf
        """Virtual time at which the run pauses [s]."""
        self._origin = (0.0, time.monotonic())
        """Virtual and wall time of the last change of speed [s]."""

    @property
    def paused(self) -> bool:
        """True if the run is paused, or will be after the current step."""
        return self._until < math.inf

    def now(self) -> float:
        """Virtual time that corresponds to the wall clock [s]."""
        virtual, wall = self._origin
        elapsed = time.monotonic() - wall
        return min(self._until, virtual + self.speed * elapsed) if self.speed else self._until

    def wait(self, t: float) -> float:
        """Return the wall time left until t [s]; infinite if the run pauses before it."""
        if t > self._until:
            return math.inf
        if not self.speed:
            return 0.0
        virtual, wall = self._origin
        return wall + (t - virtual) / self.speed - time.monotonic()

    def restart(self, t: float) -> None:
        """Set the virtual time to t [s]."""
        self._origin = (t, time.monotonic())

    def stop_at(self, until: float, now: float) -> None:
        """Pause at `until` [s]; infinite: continue. It is `now` [s]."""
        self._until = until
        self.restart(now)

    def change(self, speed: float, now: float) -> None:
        """Set another speed from `now` [s] on."""
        self.speed = speed
        self.restart(now)


class CommandQueue:
    """Scheduled and live commands, in the order in which they take effect."""

    def __init__(
        self,
        policy: CommandPolicy,
        names: tuple[str, ...],
        check_stop: Callable[[], None] = lambda: None,
    ) -> None:
        """Begin with the policy's schedule.

        check_stop is called at every wait and may raise to end the run.
        """
        self.pace, self._real_time = Pace(policy.speed), policy.real_time
        self.refusals = Refusals(log)
        self._schedule = _in_order([c for c in policy.schedule if c.changes_trajectory])
        self._names, self._check_stop = names, check_stop
        # Not queue.SimpleQueue, for the reason given in IncomingQueue.
        self._live: queue.Queue[Command] = queue.Queue()
        self._latest = 0
        self._sealer = Sealer(policy.secret)

    @property
    def next(self) -> float:
        """Time of the next scheduled command [s]; infinite if none is left."""
        return self._schedule[0].t if self._schedule else np.inf

    def wait_until(self, t: float, now: float, idle: Callable[[], None]) -> list[Command]:
        """Wait until virtual time may reach t, and return the commands that take effect there.

        Args:
            t: time of the next event [s].
            now: virtual time reached [s].
            idle: called while waiting for a resume, or for the wall clock.
        """
        commands = self._scheduled(t)
        while True:
            wait = self.pace.wait(t)
            if wait <= 0 and not self._live.queue:
                return commands
            try:
                command = self._live.get(wait > 0, timeout=max(0.0, min(wait, _POLL)))
            except queue.Empty:
                self._check_stop()
                idle()
                continue
            self._set_pace(command, now)
            commands.append(msgspec.structs.replace(command, t=t, fault=-1))

    def due(self, now: float) -> list[Command]:
        """Return the commands that take effect now [s], in real time."""
        commands = self._scheduled(now)
        while not self._live.empty():
            command = self._live.get()
            self._set_pace(command, now)
            commands.append(msgspec.structs.replace(command, t=now, fault=-1))
        return commands

    def declare(self, commands: Iterable[Command]) -> None:
        """Schedule these too, before others of the same times."""
        self._schedule = _in_order([*commands, *self._schedule])

    def add(self, command: Command) -> None:
        """Schedule a command, after others of the same time. Raises ValueError if it is invalid."""
        require_valid([command], self._names)
        self._schedule = _in_order([*self._schedule, command])

    def _scheduled(self, t: float) -> list[Command]:
        due = []
        while self._schedule and self._schedule[0].t <= t:
            due.append(self._schedule.popleft())
        return due

    def _set_pace(self, command: Command, now: float) -> None:
        match command.kind:
            case CommandKind.PAUSE:
                self.pace.stop_at(now, now)
            case CommandKind.RESUME:
                self.pace.stop_at(np.inf, now)
            case CommandKind.STEP:
                self.pace.stop_at(now + command.value, now)
            case CommandKind.SPEED:
                self.pace.change(command.value, now)

    def on_command(self, key: str, payload: bytes) -> None:
        """Accept a command if it is sealed with the secret. Called in any thread."""
        try:
            message = self._sealer.open(key, payload, CommandMessage)
            if message.number <= self._latest:
                raise Malformed("out of order")
            if refusal(message.command, self._names):
                raise Malformed("wrong command")
            kind_and_value = message.command.kind, message.command.value
            if self._real_time and kind_and_value == (CommandKind.SPEED, 0.0):
                raise Malformed("speed 0 in real time")
        except Malformed as reason:
            self.refusals.add(key, f"command: {reason}")
            return
        self._latest = message.number
        self._live.put(message.command)


def declared(swarm: Swarm) -> list[Command]:
    """Commands at the begin of each agent fault that the scenario declares, and at its end.

    Of faults that overlap at one agent and have the same effect, only the last to end ends it.
    """
    commands, renewals, occurrences = list[Command](), list[Command](), swarm.links.occurrences
    ends = _ends(occurrences)
    for occurrence in occurrences:
        agent, fault, number = occurrence.agent, occurrence.fault, occurrence.number
        begins_with, ends_with = fault.begins_with, fault.ends_with
        if begins_with is not None:
            commands.append(Command(occurrence.begin, begins_with, agent, fault=number))
        if ends_with is not None and occurrence.end in ends[agent, begins_with]:
            commands.append(Command(occurrence.end, ends_with, agent, fault=number))
        if begins_with is CommandKind.FREEZE:
            # A process that is replaced during a pause begins paused.
            renewals += [
                Command(t, begins_with, agent, fault=number)
                for t in ends.get((agent, CommandKind.KILL), ())
                if occurrence.in_force(t)
            ]
    return [*commands, *renewals]


def _ends(occurrences: Iterable[Occurrence]) -> dict[tuple[str, CommandKind | None], set[float]]:
    """Merge occurrences that overlap or touch, and return the ends [s] by agent and effect."""
    merged = defaultdict[tuple[str, CommandKind | None], list[float]](list)
    for occurrence in sorted(occurrences, key=_BEGIN):
        ends = merged[occurrence.agent, occurrence.fault.begins_with]
        last = ends.pop() if ends and occurrence.begin <= ends[-1] else occurrence.end
        ends.append(max(last, occurrence.end))
    return {effect: set(ends) for effect, ends in merged.items()}


def _in_order(commands: Iterable[Command]) -> deque[Command]:
    return deque(sorted(commands, key=lambda command: command.t))
