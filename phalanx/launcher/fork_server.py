"""The process that forks a run's programs: it builds their theory once, and all inherit it.

It never opens a Zenoh session: a process that has opened one must not fork.
"""

import gc
import multiprocessing
import os
import select
import signal
import sys
import traceback
from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from phalanx.launcher.engine import EngineError
from phalanx.launcher.programs import (
    Program,
    configure_logging,
    load_programs,
    redirect_output,
    show_as,
    start_program,
)
from phalanx.messages.membership import Membership
from phalanx.scenario.load import ScenarioError, from_json
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm

LOG = "programs.log"
"""The file of the fork server's own output, in the folder of the logs."""
_LOADING_TIMEOUT = 60
"""Time to load the programs' libraries [s], enough on the slowest machine."""


class StartRequest(NamedTuple):
    """The programs of a run to start, the plant first."""

    membership: Membership
    programs: Sequence[Program]
    logs: Path
    """Folder of the logs."""


class Report(NamedTuple):
    """One program was started, or has ended."""

    identity: str
    pid: int
    exit_code: int | None = None
    """None while it runs; negative: the signal that killed it."""


class _StopError(Exception):
    """The launcher asks for the end by SIGUSR1."""


def serve(
    scenario: str, environment: Mapping[str, str], launcher: Connection, result_pipe: Connection
) -> None:
    """Fork every program, and report on each until all have ended; on SIGUSR1 kill them.

    SIGTERM is blocked: a service manager sends it to all processes, and the plant alone reacts.

    Over `launcher` this process sends None once the scenario can run, or the exception if it
    cannot. It then receives a StartRequest, and sends a Report whenever a program starts or ends.
    An identity that it receives names a program to start again. Over `result_pipe` the plant sends
    its result.

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
    forked = _ForkedPrograms(rows, request, launcher)
    try:
        signal.signal(signal.SIGUSR1, _raise_stop)
        forked.start_all(result_pipe)
        forked.watch()
    except (_StopError, ConnectionError, EOFError) as ended:
        # A launcher that has died cannot resume the programs that it has suspended.
        forked.signal(signal.SIGKILL if isinstance(ended, _StopError) else signal.SIGCONT)
    except BaseException:
        forked.signal(signal.SIGKILL)
        raise


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


class _ForkedPrograms:
    """The programs, forked from this process."""

    def __init__(self, rows: SafetyRows, request: StartRequest, launcher: Connection) -> None:
        self._rows, self._request, self._launcher = rows, request, launcher
        self._programs = {program.identity: program for program in request.programs}
        self._running: dict[int, Report] = {}
        """By the pidfd of the process."""

    def start_all(self, result_pipe: Connection) -> None:
        """Start the plant, which builds its own theory, then compile that of the agents and start
        them.
        """
        plant, *others = self._request.programs
        begun, begin = multiprocessing.Pipe(duplex=False)
        self._start(plant, {"result_pipe": result_pipe, "agents_start": begun}, begin)
        compile_rows(self._rows)
        # Inherited pages stay shared until they are written to, as the collector would do.
        gc.collect()
        gc.freeze()
        begin.send(None)
        launcher = multiprocessing.parent_process()
        assert launcher is not None
        # Made once: a page that is written to between two forks is copied.
        death = select.poll()
        death.register(launcher.sentinel, select.POLLIN)
        for program in others:
            if death.poll(0) or _child_ended():
                break  # the run is over
            self._start(program)

    def watch(self) -> None:
        """Report on each program until all have ended, and restart those the launcher names."""
        while self._running:
            for ready in wait([self._launcher, *self._running]):
                if isinstance(ready, int):
                    self._launcher.send(_reap(self._running.pop(ready)))
                    os.close(ready)
                else:
                    self._start(self._programs[self._launcher.recv()])

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to all running programs."""
        for report in self._running.values():
            os.kill(report.pid, number)

    def _start(
        self, program: Program, options: Mapping[str, Any] = {}, kept: Connection | None = None
    ) -> None:
        """Fork one program. kept: the end of a pipe that the child must close."""
        # A SIGUSR1 between fork and registration would miss the child, or reach it alone.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
        if not (pid := os.fork()):
            if kept is not None:
                kept.close()
            program = program._replace(options={**program.options, **options})
            _run_child(program, self._rows, self._request)
        started = self._running[os.pidfd_open(pid)] = Report(program.identity, pid)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        self._launcher.send(started)


def _child_ended() -> bool:
    """Return whether any child has ended, in constant time and without reaping it."""
    return os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _reap(report: Report) -> Report:
    """Return the report with the exit code of a program that has ended."""
    _, status = os.waitpid(report.pid, 0)
    return report._replace(exit_code=os.waitstatus_to_exitcode(status))


def _raise_stop(*_: object) -> None:
    raise _StopError


def _run_child(program: Program, rows: SafetyRows, request: StartRequest) -> NoReturn:
    """Run one program in this forked process, and exit with its status."""
    status = 1
    try:
        signal.signal(signal.SIGUSR1, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        status = start_program(program, rows, request.membership, request.logs)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
