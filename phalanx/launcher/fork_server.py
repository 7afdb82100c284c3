"""The process that forks a run's programs, watches them, and ends them.

It builds their theory once, and all inherit it. It never opens a Zenoh session: a process that has
opened one must not fork.
"""

import contextlib
import gc
import math
import multiprocessing
import os
import signal
import time
import traceback
from collections.abc import Callable, Mapping, Sequence, Set
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple

from phalanx.guarantee.verdict import Outcome, Summary, exit_status
from phalanx.launcher.engine import EngineError
from phalanx.launcher.programs import (
    Program,
    configure_logging,
    load_programs,
    redirect_output,
    run_child,
    show_as,
)
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.scenario.load import from_json
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm

LOG = "programs.log"
"""The file of the fork server's own output, in the folder of the logs."""
GRACE = 4.0
"""Time for agents to leave after the plant, and for the plant to end without its launcher [s]."""
_LONGEST_END = 60.0
"""Time for the plant to stop [s]: it writes its files, unless a user's code hangs."""
_LOADING_TIMEOUT = 60
"""Time to load the programs' libraries [s], enough on the slowest machine."""
_NOTICE = 1.0
"""Time for the plant to detect by itself that an agent failed [s]."""
_LONGEST_SUSPENSION = 2.0
"""Longest suspension of a program [s]: the hub closes a connection that is silent for 10 s, and a
suspended program does not see the end of the run."""
_POLL = 0.2
"""Longest single wait [s]: a process that a program has left behind keeps its sentinel open."""
_SECOND_PRESS = 1.0
"""Least time between two Ctrl-C that count as two [s]: a shell may send the same one twice."""

_CRASHED = "Fatal Python error: "
_VERDICTS = {exit_status(outcome) for outcome in Outcome}


class StartRequest(NamedTuple):
    """The programs of a run to start, the plant first."""

    membership: Membership
    programs: Sequence[Program]
    logs: Path
    """Folder of the logs."""
    may_lose_agents: bool
    """Whether agents may be killed without ending the run."""


class RunEnded(NamedTuple):
    """All programs of the run have ended."""

    summary: Summary | None
    """As the plant sent it."""
    failure: str
    """The first program that died, how, and its last line; empty if none died."""


def serve(scenario: str, environment: Mapping[str, str], launcher: Connection) -> None:
    """Fork every program, and watch them until all have ended.

    SIGTERM is blocked: a service manager sends it to all processes, and the plant alone reacts.

    Over `launcher` this process sends None once the scenario can run, or the exception if it
    cannot. It receives a StartRequest, then methods of ForkedPrograms to call, and sends RunEnded.

    The scenario is JSON, the environment the launcher's: the libraries were loaded in another one.
    """
    show_as("phalanx-forks")
    os.environ.clear()
    os.environ.update(environment)
    try:
        rows = _build_rows(scenario)
    except Exception as error:
        launcher.send(_sendable(error))
        return
    try:
        launcher.send(None)
        request: StartRequest = launcher.recv()
    except (ConnectionError, EOFError):
        return  # the launcher has ended
    redirect_output(request.logs / LOG)
    configure_logging()
    forked = ForkedPrograms(rows, request, launcher)
    try:
        forked.start_all()
        ended = forked.watch()
    finally:
        forked.kill_all()
    with contextlib.suppress(ConnectionError):
        launcher.send(ended)


def _sendable(error: Exception) -> Exception:
    """Return the error for the launcher to raise, with the traceback as a note.

    A class that a user's code defines may not be importable in the launcher.
    """
    if not isinstance(error, ScenarioError | MemoryError | ImportError):
        error = EngineError(f"the theory cannot be built: {type(error).__name__}: {error}")
    error.add_note(traceback.format_exc())
    return error


def _build_rows(scenario: str) -> SafetyRows:
    """Build the rows of the scenario. Raises as require_runnable does."""
    # Out of memory, a library may hang while it is loaded.
    signal.alarm(_LOADING_TIMEOUT)
    load_programs()
    signal.alarm(0)
    # The libraries are never garbage: the collector need not scan them.
    gc.freeze()
    return require_runnable(build_swarm(from_json(scenario)))


class ForkedPrograms:
    """The programs of one run, forked from this process."""

    def __init__(self, rows: SafetyRows, request: StartRequest, launcher: Connection) -> None:
        self._rows, self._request, self._launcher = rows, request, launcher
        self._programs = {program.identity: program for program in request.programs}
        self._processes: dict[str, Any] = {}
        """Those that were started, by identity; a ForkProcess each."""
        self._plant, self._plants_end = multiprocessing.Pipe()
        self._sources = [launcher, self._plant]
        """Connections that are open at their other end, too."""
        self._result: Summary | str = ""
        """The plant's summary, or why there is none."""
        self._suspended: dict[str, float] = {}
        """When each program was suspended."""
        self._stop_requested = self._deadline = math.inf

    def start_all(self) -> None:
        """Start the plant, which builds its own theory, then compile that of the agents and start
        them, unless the run ends before.
        """
        plant, *agents = self._request.programs
        self._start(plant._replace(options={**plant.options, "launcher": self._plants_end}))
        self._plants_end.close()
        compile_rows(self._rows)
        # Inherited pages stay shared until they are written to, as the collector would do.
        gc.collect()
        gc.freeze()
        with contextlib.suppress(ConnectionError):
            self._plant.send(None)
        for agent in agents:
            while self._launcher in self._sources and self._launcher.poll():
                self._receive(self._launcher)
            if not (self._runs(PLANT) and self._stop_requested == self._deadline == math.inf):
                break
            self._start(agent)

    def watch(self) -> RunEnded:
        """Wait until the plant has ended, and then, for a while, until all have.

        The plant detects a dead agent by its liveliness token. If an agent fails before it has
        joined, and so has no token, the plant gets SIGUSR1.
        """
        failed = math.inf
        while self._runs(PLANT) and (now := time.monotonic()) < self._deadline:
            if self._agent_failed():
                failed = min(failed, now)
            if now > failed + _NOTICE:
                self._signal(PLANT, signal.SIGUSR1)
            if now > self._stop_requested + _LONGEST_END:
                self._signal(PLANT, signal.SIGABRT)
            self._await()
        self._deadline = min(self._deadline, time.monotonic() + GRACE)
        while any(map(self._runs, self._processes)) and time.monotonic() < self._deadline:
            self._await()
        summary = self._result if isinstance(self._result, Summary) else None
        return RunEnded(summary, self._first_failure())

    def kill_all(self) -> None:
        """Kill all programs that run."""
        for process in self._processes.values():
            process.kill()
        for process in self._processes.values():
            process.join()

    def stop(self) -> None:
        """Have the plant stop; the second time abort it, and its log says where it stood."""
        now = time.monotonic()
        second = now > self._stop_requested + _SECOND_PRESS
        self._signal(PLANT, signal.SIGABRT if second else signal.SIGTERM)
        self._stop_requested = min(self._stop_requested, now)

    def restart(self, identity: str) -> None:
        """Start a program that was killed again."""
        if not self._runs(identity):
            self._start(self._programs[identity])

    def suspend(self, identities: Set[str]) -> None:
        """Suspend these programs by SIGSTOP, each for a while at most, and resume all others."""
        for identity in self._suspended.keys() - identities:
            del self._suspended[identity]
            self._signal(identity, signal.SIGCONT)
        for identity in identities - self._suspended.keys():
            self._suspended[identity] = time.monotonic()
            self._signal(identity, signal.SIGSTOP)

    def _start(self, program: Program) -> None:
        process = multiprocessing.get_context("fork").Process(
            target=run_child,
            args=(program, self._rows, self._request.membership, self._request.logs),
            name=program.title,
        )
        process.start()
        self._processes[program.identity] = process

    def _runs(self, identity: str) -> bool:
        process = self._processes.get(identity)
        return process is not None and process.is_alive()

    def _signal(self, identity: str, number: signal.Signals) -> None:
        if self._runs(identity):
            os.kill(self._processes[identity].pid, number)

    def _await(self) -> None:
        """Wait until something comes or a program ends, not for long."""
        sentinels = [p.sentinel for p in self._processes.values() if p.is_alive()]
        for source in wait([*self._sources, *sentinels], _POLL):
            if isinstance(source, Connection):
                self._receive(source)
        for identity, since in self._suspended.items():
            if time.monotonic() > since + _LONGEST_SUSPENSION:
                self._signal(identity, signal.SIGCONT)

    def _receive(self, source: Connection) -> None:
        """Receive the plant's result, or do what the launcher asks for."""
        try:
            message = source.recv()
        except (EOFError, OSError):
            self._sources.remove(source)
            if source is self._launcher:
                self._abandon()
            return
        if source is self._plant:
            self._result = message
        else:
            request: Callable[[ForkedPrograms], None] = message
            request(self)

    def _abandon(self) -> None:
        """End the run soon: the launcher has died."""
        self.suspend(frozenset())
        self._deadline = time.monotonic() + GRACE
        with contextlib.suppress(ConnectionError):
            self._plant.send("the launcher died")

    def _agent_failed(self) -> bool:
        """Return whether an agent ended with an error, or was killed where none may be."""
        ended = {code for name, code in self._exit_codes() if name != PLANT}
        return any(code > 0 or not self._request.may_lose_agents for code in ended)

    def _exit_codes(self) -> list[tuple[str, int]]:
        """Return the codes of the programs that ended without a verdict; negative: the signal."""
        codes = [(name, process.exitcode) for name, process in self._processes.items()]
        return [(name, code) for name, code in codes if code not in {None, *_VERDICTS}]

    def _first_failure(self) -> str:
        """Describe the first program that died; agents that may be killed do not count."""
        for name, code in self._exit_codes():
            if code > 0 or name == PLANT or not self._request.may_lose_agents:
                log = self._request.logs / f"{name}.log"
                reason = self._result if name == PLANT and isinstance(self._result, str) else ""
                return death(self._programs[name].title, code, log, reason)
        return ""


def death(title: str, code: int, log: Path | None = None, reason: str = "") -> str:
    """Describe how a program died, and why: by default the last line of its log.

    code: its exit code; negative: the signal.
    """
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
    text = f"{title} died ({how})"
    if log is None:
        return text
    # On a full disk there may be no log.
    written = log.read_text(errors="replace") if log.exists() else ""
    # The traceback of a crash is for readers of the log.
    lines = written.partition(_CRASHED)[0].strip().splitlines()
    last = reason or "".join(lines[-1:])
    return f"{text}{last and f': {last}'}; log: {log}"
