"""The processes of one run on this machine: start, watch, suspend and end them."""

import contextlib
import math
import os
import signal
import threading
import time
from collections.abc import Sequence, Set
from multiprocessing.connection import wait
from pathlib import Path

from phalanx.guarantee.verdict import Outcome, Summary, exit_status
from phalanx.launcher import interrupt
from phalanx.launcher.engine import EngineError
from phalanx.launcher.fork_server import LOG, Report, StartRequest, serve
from phalanx.launcher.forkserver import without_main
from phalanx.launcher.libraries import require_handles, start_loading
from phalanx.launcher.programs import Program
from phalanx.messages.credentials import COMMAND_SECRET, SECRET
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.scenario.load import to_json
from phalanx.scenario.model import Scenario

_LONGEST_SUSPENSION = 2.0
"""Longest suspension of a program [s]: the hub closes a connection that is silent for 10 s, and a
suspended program sees neither the end of the run nor that of its launcher."""
_NOTICE = 1.0
"""Time for the plant to detect by itself that an agent failed [s]."""
_GRACE = 4.0
"""Time for agents to leave after the plant did [s]."""
_POLL = 0.2
"""Longest single wait [s]: a signal that comes just before a wait does not end it."""
_LONGEST_END = 60.0
"""Time for the plant to stop [s]: it writes its files, unless a user's code hangs."""
_SECOND_PRESS = 1.0
"""Least time between two Ctrl-C that count as two [s]: a shell may send the same one twice."""

_CRASHED = "Fatal Python error: "
_VERDICTS = {exit_status(outcome) for outcome in Outcome}


def _environment() -> dict[str, str]:
    """Return the environment without the run's secrets: agents have keys of their own."""
    return {k: v for k, v in os.environ.items() if k not in (SECRET, COMMAND_SECRET)}


class Processes(contextlib.AbstractContextManager["Processes"]):
    """The programs of one run, as the process that forks them reports on them."""

    def __init__(self, scenario: Scenario) -> None:
        """Begin to build the theory that all programs inherit. Raises EngineError."""
        self._programs: dict[str, Program] = {}
        self._logs = Path()
        self.result: Summary | str = ""
        """The plant's summary, or why there is none."""
        self._pids: dict[str, int] = {}
        self._exits: dict[str, int] = {}
        """Exit codes of the programs that have ended; negative: the signal."""
        self._killed: set[str] = set()
        self._suspended: Set[str] = frozenset()
        self._reporting = False
        """Whether reports may still come."""
        try:
            context = start_loading()
            require_handles(len(scenario.programs()))
            self._reports, theirs = context.Pipe()
            self._plant, result_pipe = context.Pipe(duplex=False)
            self._server = context.Process(
                target=serve, args=(to_json(scenario), _environment(), theirs, result_pipe)
            )
            with without_main():
                self._server.start()
        except (OSError, MemoryError, EOFError) as error:
            # EOFError: the process that loads the libraries died, and printed why.
            reason = getattr(error, "strerror", None) or error
            raise EngineError(f"no program can be started: {reason}") from error
        theirs.close()
        result_pipe.close()

    def require_runnable(self) -> None:
        """Wait until the fork server has built the theory and evaluated it at x(0).

        Raises as phalanx.swarm.runnable.require_runnable, and EngineError.
        """
        try:
            while not self._reports.poll(_POLL):
                interrupt.raise_pending()
            error: Exception | None = self._reports.recv()
        except EOFError:
            self._server.join()
            raise EngineError(_died("the fork server", self._server.exitcode or 0)) from None
        if error is not None:
            raise error

    def start(self, membership: Membership, programs: Sequence[Program], logs: Path) -> None:
        """Start the programs, the plant first. Raises OSError."""
        logs.mkdir(exist_ok=True)
        self._programs = {program.identity: program for program in programs}
        self._logs, self._reporting = logs, True
        # If the fork server died, wait_for_plant finds out.
        with contextlib.suppress(BrokenPipeError):
            self._reports.send(StartRequest(membership, programs, logs))

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def plant_runs(self) -> bool:
        """Return whether the plant is alive, or has yet to start."""
        self._take_reports(0.0)
        return self._reporting and PLANT not in self._exits

    def restart(self, identity: str) -> None:
        """Start a program that was killed again; may be called from another thread."""
        if self._exits.pop(identity, None) is not None:
            self._reports.send(identity)

    def suspend(self, identities: Set[str]) -> None:
        """Suspend these programs by SIGSTOP, and resume all others.

        After a while each resumes anyway. May be called from another thread.
        """
        for identity in self._suspended - identities:
            self._signal(identity, signal.SIGCONT)
        for identity in identities - self._suspended:
            self._signal(identity, signal.SIGSTOP)
            limit = threading.Timer(_LONGEST_SUSPENSION, self._signal, [identity, signal.SIGCONT])
            limit.daemon = True
            limit.start()
        self._suspended = identities

    def _signal(self, identity: str, number: signal.Signals) -> None:
        if identity in self._pids and identity not in self._exits:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pids[identity], number)

    # A second Ctrl-C must not interrupt the reaction to the first.
    @interrupt.deferred()
    def wait_for_plant(self, may_lose_agents: bool) -> None:
        """Wait until the plant has ended. Ctrl-C asks it to stop, the next one aborts it.

        The plant detects a dead agent by its liveliness token. If an agent fails before it has
        joined, and so has no token, the plant gets SIGUSR1.

        Args:
            may_lose_agents: whether agents may be killed without ending the run.
        """
        notified, stop_requested = False, math.inf
        while self.plant_runs:
            try:
                interrupt.raise_pending()
                if not notified and self._failed(may_lose_agents):
                    self._await_plant(_NOTICE)
                    notified = self._signal_plant(signal.SIGUSR1)
                elif time.monotonic() > stop_requested + _LONGEST_END:
                    raise KeyboardInterrupt  # as a second Ctrl-C
                else:
                    self._take_reports(_POLL)
            except KeyboardInterrupt:
                interrupt.clear()
                second = time.monotonic() > stop_requested + _SECOND_PRESS
                if not self._signal_plant(signal.SIGABRT if second else signal.SIGTERM):
                    raise
                stop_requested = math.inf if second else min(stop_requested, time.monotonic())

    def first_failure(self, may_lose_agents: bool) -> str:
        """Describe the first program that died, how, and its last line; empty if none died.

        Programs that `end` killed do not count, nor agents that may be killed.
        """
        for name, program in self._programs.items():
            code = self._exits.get(name)
            if code is None or code in _VERDICTS or name in self._killed:
                continue
            if code < 0 and may_lose_agents and name != PLANT:
                continue
            return self._failure(program.title, code, f"{name}.log", name == PLANT)
        if self._server.exitcode:
            return self._failure("the fork server", self._server.exitcode, LOG)
        return ""

    @interrupt.deferred()
    def end(self) -> None:
        """End all processes: wait for the agents to leave, then kill them."""
        if not self._programs or (self.plant_runs and not self._signal_plant(signal.SIGTERM)):
            self._end_server()
        deadline = time.monotonic() + _GRACE
        while self._reporting and (left := deadline - time.monotonic()) > 0:
            self._take_reports(left)
        self._killed = set(self._pids) - set(self._exits)
        if self._reporting:
            self._end_server()
        self._server.join()
        if (self._server.exitcode or 0) < 0:
            # The fork server does it, unless it was killed itself; the system may then reuse pids.
            for name in self._killed:
                with contextlib.suppress(OSError):
                    os.kill(self._pids[name], signal.SIGKILL)
        self._pids.clear()  # likewise

    def _end_server(self) -> None:
        """Let the fork server kill all that it has forked, and end."""
        if self._server.is_alive() and self._server.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._server.pid, signal.SIGUSR1)

    def _take_reports(self, timeout: float | None) -> None:
        """Receive all reports that have come; wait for one if none has."""
        try:
            while ready := wait([self._plant, self._reports], timeout):
                timeout = 0.0
                if self._plant in ready:
                    # At its end when all programs are gone: how they ended is in the reports.
                    with contextlib.suppress(EOFError, OSError):
                        self.result = self._plant.recv()
                if self._reports in ready:
                    report: Report = self._reports.recv()
                    self._pids[report.identity] = report.pid
                    if report.exit_code is not None:
                        self._exits[report.identity] = report.exit_code
        except EOFError:
            self._reporting = False

    def _await_plant(self, timeout: float) -> None:
        deadline = time.monotonic() + timeout
        while self.plant_runs and (left := deadline - time.monotonic()) > 0:
            self._take_reports(left)

    def _signal_plant(self, number: signal.Signals) -> bool:
        """Send the plant a signal if it runs, and return whether it has started."""
        if self.plant_runs and PLANT in self._pids:
            with contextlib.suppress(ProcessLookupError):  # its end is not reported yet
                os.kill(self._pids[PLANT], number)
        return PLANT in self._pids

    def _failed(self, may_lose_agents: bool) -> bool:
        """Return whether an agent ended with an error, or was killed where none may be."""
        ended = {code for name, code in self._exits.items() if name != PLANT} - _VERDICTS
        return any(code > 0 or not may_lose_agents for code in ended)

    def _failure(self, title: str, code: int, log_name: str, plant: bool = False) -> str:
        log = self._logs / log_name
        text = log.read_text(errors="replace") if log.exists() else ""
        # The traceback of a crash is for readers of the log.
        lines = text.partition(_CRASHED)[0].strip().splitlines()
        # On a full disk there may be no log.
        reason = self.result if plant and isinstance(self.result, str) else ""
        last = reason or "".join(lines[-1:])
        return f"{_died(title, code)}{last and f': {last}'}; log: {log}"


def _died(title: str, code: int) -> str:
    """Describe the death of a program by its exit code; negative: the signal."""
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
    return f"{title} died ({how})"
