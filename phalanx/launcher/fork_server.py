"""The process that starts a run's programs: it builds their theory once, and all inherit it.

It never opens a session: a process that has opened one must not fork.
"""

import gc
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import traceback
from collections.abc import Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple, NoReturn

from phalanx.launcher.programs import (
    Program,
    load_programs,
    redirect_output,
    show_as,
    start_program,
)
from phalanx.scenario.load import from_json
from phalanx.swarm.compile import compile_rows
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.membership import Membership

LOG = "programs.log"
"""What the fork server itself prints, in the folder of the logs."""
_LOADED = 60
"""The programs' libraries are loaded by then [s], on the slowest machine."""


class Report(NamedTuple):
    """One program was started, or has ended."""

    identity: str
    pid: int
    exit_code: int | None = None
    """None while it runs; negative: the signal that killed it."""


class _StopError(Exception):
    """The launcher waits no longer."""


def serve(
    scenario: str,
    membership: Membership,
    programs: Sequence[Program],
    logs: Path,
    launcher: Connection,
) -> None:
    """Fork every program, and report on each until all have ended; on SIGTERM kill them.

    Args:
        scenario: resolved, as JSON.
        membership: of the run.
        programs: in the order in which they are to start.
        logs: folder of the logs.
        launcher: takes a Report when a program was started, and when it has ended; whose identity
            comes from there is started again.
    """
    show_as("phalanx-forks")
    redirect_output(logs / LOG)
    rows = _theory(scenario, programs)
    running: dict[int, Report] = {}
    """By a file descriptor of the process."""

    def start(program: Program) -> None:
        # Until the child is known here it must not be missed, and it must not take what is
        # meant for this process.
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
        if not (pid := os.fork()):
            _become(program, rows, membership, logs)
        started = running[os.pidfd_open(pid)] = Report(program.identity, pid)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        launcher.send(started)

    parent = multiprocessing.parent_process()
    assert parent is not None
    try:
        signal.signal(signal.SIGTERM, _stop)
        for program in programs:
            if multiprocessing.connection.wait([parent.sentinel], timeout=0.0):
                break  # it died while the theory was built: nobody waits for the run
            start(program)
        while running:
            for ready in multiprocessing.connection.wait([launcher, *running]):
                if isinstance(ready, int):
                    launcher.send(_ended(running.pop(ready)))
                    os.close(ready)
                else:
                    identity = launcher.recv()
                    start(next(p for p in programs if p.identity == identity))
    except (_StopError, ConnectionError, EOFError) as ended:
        # Without a launcher nobody would let those go on that it has stopped.
        last = signal.SIGKILL if isinstance(ended, _StopError) else signal.SIGCONT
        for report in running.values():
            os.kill(report.pid, last)


def _theory(scenario: str, programs: Sequence[Program]) -> SafetyRows:
    """What all programs inherit: their libraries, and the rows of the scenario, compiled."""
    # Out of memory, a library may wait for ever while it is loaded.
    signal.alarm(_LOADED)
    load_programs(programs)
    signal.alarm(0)
    rows = build_rows(build_swarm(from_json(scenario)))
    compile_rows(rows)
    # What programs inherit stays shared as long as nobody writes to it, as a collector would.
    gc.collect()
    gc.freeze()
    return rows


def _ended(report: Report) -> Report:
    """Of a program that has ended."""
    _, status = os.waitpid(report.pid, 0)
    return report._replace(exit_code=os.waitstatus_to_exitcode(status))


def _stop(*_: object) -> None:
    raise _StopError


def _become(program: Program, rows: SafetyRows, membership: Membership, logs: Path) -> NoReturn:
    """Be one program in this process, a forked one, until it ends."""
    status = 1
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGTERM})
        status = start_program(program, rows, membership, logs)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
