"""The process that starts a run's programs: it builds their theory once, and all inherit it.

It never opens a session: a process that has opened one must not fork.
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
from phalanx.scenario.load import ScenarioError, from_json
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.runnable import compile_rows, require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.membership import Membership

LOG = "programs.log"
"""What the fork server itself prints, in the folder of the logs."""
_LOADED = 60
"""The programs' libraries are loaded by then [s], on the slowest machine."""


class Order(NamedTuple):
    """What is to be started."""

    membership: Membership
    """Of the run."""
    programs: Sequence[Program]
    """In the order in which they are to start, the plant first."""
    logs: Path
    """Folder of the logs."""


class Report(NamedTuple):
    """One program was started, or has ended."""

    identity: str
    pid: int
    exit_code: int | None = None
    """None while it runs; negative: the signal that killed it."""


class _StopError(Exception):
    """The launcher waits no longer."""


def serve(
    scenario: str, environment: Mapping[str, str], launcher: Connection, last_words: Connection
) -> None:
    """Fork every program, and report on each until all have ended; on SIGUSR1 kill them.

    SIGTERM is blocked: a service manager sends it to all, and only the plant decides what it means.

    Args:
        scenario: resolved, as JSON.
        environment: the launcher's; the libraries were loaded in another one.
        launcher: takes None once the scenario is known to be one that can run, or the exception
            that says why it is not; has then the Order; takes a Report when a program was started,
            and when it has ended; whose identity comes from there is started again.
        last_words: the plant's.
    """
    show_as("phalanx-forks")
    os.environ.clear()
    os.environ.update(environment)
    try:
        rows = _runnable(scenario)
    except Exception as error:
        launcher.send(_told(error))
        return
    try:
        launcher.send(None)
        order: Order = launcher.recv()
    except (ConnectionError, EOFError):
        return  # nobody waits for the run
    redirect_output(order.logs / LOG)
    configure_logging()
    forks = _Forks(rows, order, launcher)
    try:
        signal.signal(signal.SIGUSR1, _stop)
        forks.start_all(last_words)
        forks.watch()
    except (_StopError, ConnectionError, EOFError) as ended:
        # Without a launcher nobody would let those go on that it has stopped.
        forks.signal(signal.SIGKILL if isinstance(ended, _StopError) else signal.SIGCONT)
    except BaseException:
        forks.signal(signal.SIGKILL)
        raise


def _told(error: Exception) -> Exception:
    """What the launcher raises of it, with the traceback as a note.

    An exception of a user's own may not survive to be sent.
    """
    if not isinstance(error, ScenarioError | MemoryError | ImportError):
        error = EngineError(f"the theory cannot be built: {type(error).__name__}: {error}")
    error.add_note(traceback.format_exc())
    return error


def _runnable(scenario: str) -> SafetyRows:
    """The rows of the scenario. Raises as require_runnable does."""
    # Out of memory, a library may wait for ever while it is loaded.
    signal.alarm(_LOADED)
    load_programs()
    signal.alarm(0)
    # None of it is ever garbage: while the theory is built, the collector need not look at it.
    gc.freeze()
    return require_runnable(build_swarm(from_json(scenario)))


class _Forks:
    """The programs, forked from this process."""

    def __init__(self, rows: SafetyRows, order: Order, launcher: Connection) -> None:
        self._rows, self._order, self._launcher = rows, order, launcher
        self._programs = {program.identity: program for program in order.programs}
        self._running: dict[int, Report] = {}
        """By a file descriptor of the process."""

    def start_all(self, last_words: Connection) -> None:
        """Start the plant, which has a theory of its own to build, then all that share theirs."""
        plant, *others = self._order.programs
        begun, begin = multiprocessing.Pipe(duplex=False)
        self._start(plant, {"last_words": last_words, "agents_start": begun}, begin)
        compile_rows(self._rows)
        # What programs inherit stays shared as long as nobody writes to it, as a collector would.
        gc.collect()
        gc.freeze()
        begin.send(None)
        launcher = multiprocessing.parent_process()
        assert launcher is not None
        # Made once: what is written to between two forks has its page copied.
        death = select.poll()
        death.register(launcher.sentinel, select.POLLIN)
        for program in others:
            if death.poll(0) or _one_ended():
                break  # there is no run
            self._start(program)

    def watch(self) -> None:
        """Report on each program until all have ended, and start again whom the launcher names."""
        while self._running:
            for ready in wait([self._launcher, *self._running]):
                if isinstance(ready, int):
                    self._launcher.send(_ended(self._running.pop(ready)))
                    os.close(ready)
                else:
                    self._start(self._programs[self._launcher.recv()])

    def signal(self, number: signal.Signals) -> None:
        """Send a signal to all that run."""
        for report in self._running.values():
            os.kill(report.pid, number)

    def _start(
        self, program: Program, options: Mapping[str, Any] = {}, kept: Connection | None = None
    ) -> None:
        """kept: this process's own end of a pipe, so that the other end sees it die."""
        # Until the child is known here it must not be missed, and it must not take what is
        # meant for this process.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
        if not (pid := os.fork()):
            if kept is not None:
                kept.close()
            program = program._replace(options={**program.options, **options})
            _become(program, self._rows, self._order)
        started = self._running[os.pidfd_open(pid)] = Report(program.identity, pid)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        self._launcher.send(started)


def _one_ended() -> bool:
    """Whether one of the programs has ended; the same work, however many there are."""
    return os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None


def _ended(report: Report) -> Report:
    """Of a program that has ended."""
    _, status = os.waitpid(report.pid, 0)
    return report._replace(exit_code=os.waitstatus_to_exitcode(status))


def _stop(*_: object) -> None:
    raise _StopError


def _become(program: Program, rows: SafetyRows, order: Order) -> NoReturn:
    """Be one program in this process, a forked one, until it ends."""
    status = 1
    try:
        signal.signal(signal.SIGUSR1, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGUSR1})
        status = start_program(program, rows, order.membership, order.logs)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
