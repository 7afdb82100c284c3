"""Commands from outside the scenario: when they take effect, and how fast virtual time may go."""

import logging
import queue
import time
from collections import deque
from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from phalanx.faults.commands import Command, CommandKind, CommandPolicy, refusal
from phalanx.swarm.swarm import Swarm
from phalanx.wire.frames import CommandMessage
from phalanx.wire.refusals import Refusals
from phalanx.wire.seal import Malformed, Sealer

log = logging.getLogger("phalanx.plant")

_GLANCE = 0.03
"""How often a wait shows the run and looks whether it was stopped [s]."""


class CommandQueue:
    """Scheduled and live commands, in the order in which the run obeys them."""

    def __init__(
        self,
        policy: CommandPolicy,
        names: tuple[str, ...],
        check_stop: Callable[[], None] = lambda: None,
    ) -> None:
        """check_stop is called at every wait and may raise to end the run."""
        self.speed = policy.speed
        self.refusals = Refusals(log)
        self._schedule = _in_order([c for c in policy.schedule if c.changes_trajectory])
        self._names, self._check_stop = names, check_stop
        self._live: queue.SimpleQueue[Command] = queue.SimpleQueue()
        self._until = np.inf
        """Virtual time stands still beyond it [s]."""
        self._origin = (0.0, time.monotonic())
        """Virtual and wall time from which the speed counts."""
        self._latest = 0
        self._sealer = Sealer(policy.secret)

    @property
    def next(self) -> float:
        """When the next scheduled control takes effect [s]; infinite if none is left."""
        return self._schedule[0].t if self._schedule else np.inf

    @property
    def paused(self) -> bool:
        """Whether virtual time stands still, or is about to."""
        return bool(self._until < np.inf)

    def take(self, now: float, t: float, idle: Callable[[], None]) -> list[Command]:
        """The commands to obey at the next event.

        Args:
            now: virtual time reached [s].
            t: of the next event [s]; live commands take effect there.
            idle: called while virtual time has to wait: for a resume, or for the wall clock.
        """
        taken = []
        while self._schedule and self._schedule[0].t <= t:
            taken.append(self._schedule.popleft())
        while True:
            wait = self._wait(t)
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

    def _wait(self, t: float) -> float:
        """How long to wait before the event at t [s of wall time]."""
        if t > self._until:
            return np.inf
        if not self.speed:
            return 0.0
        virtual, wall = self._origin
        return wall + (t - virtual) / self.speed - time.monotonic()

    def declare(self, commands: Iterable[Command]) -> None:
        """Obey these too, before others of their times."""
        self._schedule = _in_order([*commands, *self._schedule])

    def start(self) -> None:
        """The run begins: the wall clock counts from here."""
        self._origin = (0.0, time.monotonic())

    def _set_pace(self, command: Command, now: float) -> None:
        match command.kind:
            case CommandKind.PAUSE:
                self._until = now
            case CommandKind.RESUME:
                self._until = np.inf
            case CommandKind.STEP:
                self._until = now + command.value
            case CommandKind.SPEED:
                self.speed = command.value
            case _:
                return
        self._origin = (now, time.monotonic())

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
        Command(t, kind, strike.agent, fault=swarm.links.number(place))
        for place, fault, strike in swarm.struck
        for t, kind in fault.commands(strike)
    ]


def _in_order(commands: Iterable[Command]) -> deque[Command]:
    return deque(sorted(commands, key=lambda command: command.t))
