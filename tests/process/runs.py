"""Runs in the background of a test, and waiting for what they do."""

import contextlib
import math
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import psutil
from phalanx_viewer.feeds.live import Live

import phalanx
from phalanx.faults.commands import NO_COMMANDS, CommandKind, CommandPolicy
from phalanx.guarantee.verdict import Summary
from phalanx.launcher.engine import RunOptions, execute
from phalanx.messages.kinds import Status
from phalanx.messages.membership import Membership
from phalanx.scenario.model import Scenario
from phalanx.wire.session import free_endpoint

T = TypeVar("T")
SECRET, COMMAND_SECRET = b"the run's secret", b"the command secret"
HELD = CommandPolicy(secret=COMMAND_SECRET, speed=0.005)
"""So slow that a run is not over before the slowest browser has come; then LiveRun.set_speed."""
PACED = CommandPolicy(secret=COMMAND_SECRET, speed=0.2)
"""Slow enough for commands to come in time."""
_ANEW = 10.0
"""After so long a command is put again [s]: one that is put into a flood may be lost."""


def on_both_engines(scenario: Scenario, **options: Any) -> tuple[phalanx.Run, phalanx.Run]:
    """Runs in process and as processes, which agree on every state and step and on all events."""
    first, second = (
        phalanx.run(scenario, engine=engine, **options) for engine in ("in-process", "processes")
    )
    for field in ("trajectory", "steps", "faults", "rejected", "assumptions", "trust"):
        assert getattr(first.summary, field) == getattr(second.summary, field)
    assert first.events.drop("run").equals(second.events.drop("run"))
    return first, second


class LiveRun:
    """A launch under way."""

    def __init__(
        self,
        scenario: Scenario,
        folder: Path,
        policy: CommandPolicy,
        endpoint: str = "",
        real_time: float | None = None,
    ) -> None:
        """Start the real launcher in a thread, with processes as ever."""
        folder.mkdir()
        self.folder, self.endpoint = folder, endpoint or free_endpoint()
        self.status: Status | None = None
        self._summary: Summary | None = None
        arguments = scenario, policy, real_time
        self._thread = threading.Thread(target=self._run, args=arguments, daemon=True)
        self._thread.start()

    def _run(self, scenario: Scenario, policy: CommandPolicy, real_time: float | None) -> None:
        self._summary = execute(
            scenario,
            self.folder,
            RunOptions(
                progress=self._keep,
                commands=policy,
                listen=self.endpoint,
                secret=SECRET,
                real_time=real_time,
            ),
        )

    def _keep(self, status: Status) -> None:
        self.status = status

    def watch(self, command_secret: bytes = COMMAND_SECRET) -> Live:
        """A viewer without a page; with the command secret it may command the run."""
        return Live(Membership(self.folder.name, self.endpoint, SECRET), command_secret)

    def set_speed(self, speed: float) -> None:
        """Change the pace; returns when the run goes at it."""
        with self.watch() as live:
            times = [-math.inf]

            def goes_at_it() -> bool:
                if time.monotonic() > times[-1] + _ANEW:
                    live.command(CommandKind.SPEED, value=speed)
                    times.append(time.monotonic())
                frame = live.take()
                return frame is not None and frame.speed == speed

            wait_for(goes_at_it)

    def stop(self) -> None:
        """Do not wait for a run that may stand still for ever."""
        for process in psutil.Process().children(recursive=True):
            if process.name() == "phx-plant":
                process.terminate()
        self._thread.join(30.0)

    def summary(self, timeout: float = 120.0) -> Summary:
        """Wait for the verdict."""
        self._thread.join(timeout)
        assert self._summary is not None, "the run came to no verdict"
        return self._summary


@contextlib.contextmanager
def live_run(
    scenario: Scenario,
    folder: Path,
    policy: CommandPolicy = NO_COMMANDS,
    endpoint: str = "",
    real_time: float | None = None,
) -> Iterator[LiveRun]:
    """A run in the background; whatever the test does, it is over at the end."""
    run = LiveRun(scenario, folder, policy, endpoint, real_time)
    try:
        yield run
    except BaseException:
        run.stop()
        raise
    run.summary()


def wait_for(condition: Callable[[], T], seconds: float = 120.0) -> T:
    """The condition's first truthy value; fails after `seconds`."""
    deadline = time.monotonic() + seconds
    while True:
        began = time.thread_time()
        if value := condition():
            return value
        assert time.monotonic() < deadline, "the condition did not come true in time"
        # A look at all processes takes milliseconds, of which those under test should have most.
        time.sleep(min(max(0.01, 4.0 * (time.thread_time() - began)), 0.05))


def free_port() -> int:
    """Return a port that was not used lately: a browser's tab reconnects to its server's port.

    The first free port from the viewer's own on would often be that of an earlier test, or of one
    in another process, whose tab is still open. The system gives those from 32768 on to whatever
    connects or listens next, perhaps before the test listens.
    """
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
            return port
