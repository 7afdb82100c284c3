"""Commands from outside the scenario: when they take effect, and how fast virtual time may go."""

import logging
import math
import queue
import time
from collections import deque
from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from phalanx.faults.commands import Command, CommandKind, CommandPolicy, refusal
from phalanx.swarm.swarm import Swarm
from phalanx.wire.messages import CommandMessage
from phalanx.wire.seal import Malformed, Refusals, Sealer

log = logging.getLogger("phalanx.plant")

_GLANCE = 0.03
"""How often a wait shows the run and looks whether it was stopped [s]."""


class Pace:
    """Virtual against wall time, since the last change of the speed."""

    def __init__(self, speed: float) -> None:
        """speed: seconds of virtual time per second, at most; 0: as fast as it goes."""
        self.speed = speed
        self._until = math.inf
        """Virtual time stands still beyond it [s]."""
        self._origin = (0.0, time.monotonic())
        """Virtual and wall time from which the speed counts."""

    @property
    def paused(self) -> bool:
        """Whether virtual time stands still, or is about to."""
        return self._until < math.inf

    def now(self) -> float:
        """Where virtual time is, if nothing else holds it up [s]."""
        virtual, wall = self._origin
        elapsed = time.monotonic() - wall
        return min(self._until, virtual + self.speed * elapsed) if self.speed else self._until

    def wait(self, t: float) -> float:
        """How long it is until t [s of wall time]; infinite if virtual time stops before it."""
        if t > self._until:
            return math.inf
        if not self.speed:
            return 0.0
        virtual, wall = self._origin
        return wall + (t - virtual) / self.speed - time.monotonic()

    def restart(self, t: float) -> None:
        """It is t [s] now."""
        self._origin = (t, time.monotonic())

    def stop_at(self, until: float, now: float) -> None:
        """Go no further than `until` [s]; infinite: go on. It is `now` [s]."""
        self._until = until
        self.restart(now)

    def change(self, speed: float, now: float) -> None:
        """Go at another speed from `now` [s] on."""
        self.speed = speed
        self.restart(now)


class CommandQueue:
    """Scheduled and live commands, in the order in which the run obeys them."""

    def __init__(
        self,
        policy: CommandPolicy,
        names: tuple[str, ...],
        check_stop: Callable[[], None] = lambda: None,
    ) -> None:
        """check_stop is called at every wait and may raise to end the run."""
        self.pace = Pace(policy.speed)
        self.refusals = Refusals(log)
        self._schedule = _in_order([c for c in policy.schedule if c.changes_trajectory])
        self._names, self._check_stop = names, check_stop
        # Not queue.SimpleQueue, for the reason that Arrivals has.
        self._live: queue.Queue[Command] = queue.Queue()
        self._latest = 0
        self._sealer = Sealer(policy.secret)

    @property
    def next(self) -> float:
        """When the next scheduled control takes effect [s]; infinite if none is left."""
        return self._schedule[0].t if self._schedule else np.inf

    def take(self, now: float, t: float, idle: Callable[[], None]) -> list[Command]:
        """The commands to obey at the next event.

        Args:
            now: virtual time reached [s].
            t: of the next event [s]; live commands take effect there.
            idle: called while virtual time has to wait: for a resume, or for the wall clock.
        """
        taken = self._scheduled(t)
        while True:
            wait = self.pace.wait(t)
            try:
                command = self._live.get(wait > 0, timeout=max(0.0, min(wait, _GLANCE)))
            except queue.Empty:
                if wait <= 0:
                    return taken
                self._check_stop()
                idle()
                continue
            self._set_pace(command, now)
            taken.append(msgspec.structs.replace(command, t=t, fault=-1))

    def come(self, now: float) -> list[Command]:
        """The commands to obey now [s], in real time, where nobody waits."""
        taken = self._scheduled(now)
        while not self._live.empty():
            command = self._live.get()
            if command.kind != CommandKind.SPEED or command.value:
                self._set_pace(command, now)
                taken.append(msgspec.structs.replace(command, t=now, fault=-1))
        return taken

    def declare(self, commands: Iterable[Command]) -> None:
        """Obey these too, before others of their times."""
        self._schedule = _in_order([*commands, *self._schedule])

    def _scheduled(self, t: float) -> list[Command]:
        taken = []
        while self._schedule and self._schedule[0].t <= t:
            taken.append(self._schedule.popleft())
        return taken

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
        """Take a command in, in whatever thread it comes; only what the secret sealed counts."""
        try:
            message = self._sealer.open(key, payload, CommandMessage)
            if message.number <= self._latest:
                raise Malformed("out of order")
            if refusal(message.command, self._names):
                raise Malformed("wrong command")
        except Malformed as reason:
            self.refusals.add(key, f"command: {reason}")
            return
        self._latest = message.number
        self._live.put(message.command)


def declared(swarm: Swarm) -> list[Command]:
    """The commands that the scenario's faults of agents amount to."""
    return [
        Command(t, kind, each.agent, fault=each.number)
        for each in swarm.links.occurrences
        for t, kind in ((each.begin, each.fault.begins_with), (each.end, each.fault.ends_with))
        if kind is not None
    ]


def _in_order(commands: Iterable[Command]) -> deque[Command]:
    return deque(sorted(commands, key=lambda command: command.t))
