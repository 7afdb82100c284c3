"""The processes engine: the plant and every agent, each a process of its own, over Zenoh.

The launcher asks a fork server to start and to watch the programs. They communicate over Zenoh
alone, and each stops by itself: agents when the hub is gone, the plant when it is done, on SIGTERM,
or when the launcher dies.
"""

import contextlib
import multiprocessing
import os
import secrets
from collections.abc import Callable, Iterator, Set
from functools import partial
from pathlib import Path

from phalanx.faults.commands import EFFECTS
from phalanx.faults.fault import AgentFault, Fault
from phalanx.guarantee.verdict import Outcome, Summary, read_summary
from phalanx.launcher import interrupt
from phalanx.launcher.engine import EngineError, Progress, RunOptions
from phalanx.launcher.fork_server import (
    GRACE,
    LOG,
    ForkedPrograms,
    RunEnded,
    StartRequest,
    death,
    serve,
)
from phalanx.launcher.libraries import require_handles, start_process
from phalanx.launcher.live import announced
from phalanx.launcher.programs import Program
from phalanx.messages.credentials import COMMAND_SECRET, SECRET
from phalanx.messages.keys import PLANT
from phalanx.messages.kinds import SAYS, Status
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed
from phalanx.recording.records import SUMMARY
from phalanx.scenario.model import Scenario, to_json
from phalanx.schema.user_code import of_session
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import HubError, open_client, reserved_endpoint

_POLL = 0.2
"""Longest single wait [s]: a signal that comes just before a wait does not end it."""


def run_processes(
    scenario: Scenario, make_folder: Callable[[], Path], options: RunOptions
) -> Summary:
    """Run a scenario to its verdict, as an Engine; progress is called in a thread of Zenoh's."""
    for name in of_session(scenario.model_dump(mode="json")):
        raise EngineError(
            f"{name} is of this script or notebook, which other processes cannot import: write it "
            "into a file of its own, or take engine 'in-process'"
        )
    with Processes(scenario) as processes, reserved_endpoint() as endpoint:
        processes.require_runnable()
        folder = make_folder()
        membership = Membership(
            run=folder.name,
            endpoint=options.listen or endpoint,
            secret=options.secret or secrets.token_bytes(16),
        )
        return _run(processes, scenario, folder, membership, options)


def _run(
    processes: "Processes",
    scenario: Scenario,
    folder: Path,
    membership: Membership,
    options: RunOptions,
) -> Summary:
    logs, programs = folder / "logs", _programs(scenario, folder, options)
    try:
        logs.mkdir(exist_ok=True)
    except OSError as error:
        raise EngineError(f"no program could be started: {error}") from error
    processes.start(StartRequest(membership, programs, logs, _may_lose(scenario, options)))
    # A Ctrl-C ends the run where it is waited for, and leaves no file behind.
    with (
        interrupt.deferred(),
        announced(folder, membership),
        _status_handled(scenario, membership, processes, options.progress),
    ):
        options.announce(folder)
        ended = processes.wait()
    summary = ended.summary
    with contextlib.suppress(OSError, ValueError):  # the disk may be full
        summary = read_summary((folder / SUMMARY).read_bytes())
    if summary is None:
        raise EngineError(
            ended.failure or f"the plant ended without a verdict: see {logs / 'plant.log'}"
        )
    explained = SAYS in summary.reason or summary.reason in ended.failure
    if summary.outcome is Outcome.BROKEN and ended.failure and not explained:
        summary.reason = f"{summary.reason} [{ended.failure}]"
    return summary


def _programs(scenario: Scenario, folder: Path, options: RunOptions) -> list[Program]:
    plant = {"folder": folder, "policy": options.commands, "real_time": options.real_time}
    return [Program(PLANT, plant), *map(Program, scenario.programs())]


def _may_lose(scenario: Scenario, options: RunOptions) -> bool:
    """Return whether an agent's process may be killed without ending the run."""
    commanded = bool(options.commands.secret or options.commands.schedule)
    in_real_time = options.real_time is not None
    return commanded or in_real_time or any(map(_is_of_process, scenario.faults))


def _is_of_process(fault: Fault) -> bool:
    """Return whether a fault kills, starts or stops an agent's process."""
    begins = fault.begins_with if isinstance(fault, AgentFault) else None
    return bool(begins and EFFECTS[begins].process)


@contextlib.contextmanager
def _status_handled(
    scenario: Scenario,
    membership: Membership,
    processes: "Processes",
    progress: Progress,
) -> Iterator[None]:
    """During the block report progress, and restart, suspend and resume as the status requests."""
    keys, sealer = membership.keys, membership.sealer
    program_of = {name: p for p, names in scenario.programs().items() for name in names}

    def on_status(key: str, payload: bytes) -> None:
        with contextlib.suppress(Malformed):
            status = sealer.open(key, payload, Status)
            processes.suspend({program_of[name] for name in status.stopped})
            for name in status.waiting_for if status.restart else ():
                processes.restart(program_of[name])
            progress(status)

    session = None
    while session is None and processes.running:
        interrupt.raise_pending()
        with contextlib.suppress(HubError):
            session = open_client(membership.endpoint, 0.5, membership.credentials)
    if session is None:
        yield
        return
    with session:
        subscribe(session, keys.status, on_status)
        yield


def _environment() -> dict[str, str]:
    """Return the environment without the run's secrets: agents have keys of their own."""
    return {k: v for k, v in os.environ.items() if k not in (SECRET, COMMAND_SECRET)}


class Processes(contextlib.AbstractContextManager["Processes"]):
    """The programs of one run, and the fork server that starts and watches them."""

    def __init__(self, scenario: Scenario) -> None:
        """Begin to build the theory that all programs inherit. Raises EngineError."""
        self._log: Path | None = None
        """The fork server's, once it may start programs."""
        self._suspended: Set[str] = frozenset()
        try:
            require_handles(len(scenario.programs()))
            self._connection, theirs = multiprocessing.Pipe()
            self._server = start_process(serve, to_json(scenario), _environment(), theirs)
        except (OSError, MemoryError, EOFError) as error:
            # EOFError: the process that loads the libraries died, and printed why.
            reason = getattr(error, "strerror", None) or error
            raise EngineError(f"no program can be started: {reason}") from error
        theirs.close()

    def require_runnable(self) -> None:
        """Wait until the fork server has built the theory and evaluated it at x(0).

        Raises as phalanx.swarm.runnable.require_runnable, and EngineError.
        """
        try:
            while not self._connection.poll(_POLL):
                interrupt.raise_pending()
            error: Exception | None = self._connection.recv()
        except (EOFError, ConnectionError):
            raise EngineError(self._death()) from None
        if error is not None:
            raise error

    def start(self, request: StartRequest) -> None:
        """Start the programs, the plant first."""
        self._log = request.logs / LOG
        self._send(request)

    @property
    def running(self) -> bool:
        """True until all programs have ended."""
        return not self._connection.poll()

    def restart(self, identity: str) -> None:
        """Start a program that was killed again; may be called from another thread."""
        self._send(partial(ForkedPrograms.restart, identity=identity))

    def suspend(self, identities: Set[str]) -> None:
        """Suspend these programs and resume all others; may be called from another thread."""
        if identities != self._suspended:
            self._suspended = identities
            self._send(partial(ForkedPrograms.suspend, identities=identities))

    # A second Ctrl-C must not interrupt the reaction to the first.
    @interrupt.deferred()
    def wait(self) -> RunEnded:
        """Wait until all have ended. Ctrl-C asks the plant to stop, the next one aborts it."""
        try:
            while not self._connection.poll(_POLL):
                try:
                    interrupt.raise_pending()
                except KeyboardInterrupt:
                    interrupt.clear()
                    self._send(ForkedPrograms.stop)
            ended: RunEnded = self._connection.recv()
        except (EOFError, ConnectionError):
            return RunEnded(None, self._death())
        return ended

    @interrupt.deferred()
    def __exit__(self, *_: object) -> None:
        """End all processes that run: the plant has time to stop."""
        if self._log is None:
            self._server.kill()
        self._send(ForkedPrograms.stop)
        self._connection.close()
        self._server.join(2.0 * GRACE)
        self._server.kill()
        self._server.join()

    def _send(self, message: object) -> None:
        # If the fork server has ended, wait finds out.
        with contextlib.suppress(ConnectionError):
            self._connection.send(message)

    def _death(self) -> str:
        self._server.join()
        return death("the fork server", self._server.exitcode or 0, self._log)
