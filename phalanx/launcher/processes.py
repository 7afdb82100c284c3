"""The processes of one run on this machine: started, watched, and never left behind."""

import contextlib
import math
import os
import signal
import threading
import time
from collections.abc import Sequence, Set
from multiprocessing.connection import wait
from pathlib import Path
from typing import Self

from phalanx.compat.forkserver import without_main
from phalanx.guarantee.verdict import Outcome, Summary, exit_status
from phalanx.launcher import interrupt
from phalanx.launcher.engine import EngineError
from phalanx.launcher.fork_server import LOG, Order, Report, serve
from phalanx.launcher.libraries import require_handles, start_loading
from phalanx.launcher.programs import Program
from phalanx.scenario.load import to_json
from phalanx.scenario.model import Scenario
from phalanx.wire.credentials import COMMAND_SECRET, SECRET
from phalanx.wire.keys import PLANT
from phalanx.wire.membership import Membership

_LONGEST_STOP = 2.0
"""How long a program may be stopped [s]: the hub gives up a connection that is silent for 10 s, and
one that is stopped sees neither the end of the run nor that of its launcher."""
_NOTICE = 1.0
"""How long the plant gets to see by itself that an agent failed [s]."""
_GRACE = 4.0
"""How long agents get to leave after the plant did [s]."""
_GLANCE = 0.2
"""How often a wait looks up [s]: a signal may come just before it begins, and not end it."""
_LONGEST_END = 60.0
"""How long the plant gets to stop [s]: it writes down what it has, unless a user's code hangs."""
_AGAIN = 1.0
"""A Ctrl-C so long after another one is one of its own [s]: a shell may send both at once."""

_CRASHED = "Fatal Python error: "
_VERDICTS = {exit_status(outcome) for outcome in Outcome}


def _environment() -> dict[str, str]:
    """The environment of programs: agents may not have what others are known by."""
    return {k: v for k, v in os.environ.items() if k not in (SECRET, COMMAND_SECRET)}


class Processes:
    """The programs of one run, as the process that forks them reports on them."""

    def __init__(self, scenario: Scenario) -> None:
        """Begin to build the theory that all programs inherit. Raises EngineError."""
        try:
            context = start_loading()
            require_handles(len(scenario.programs()))
            self._reports, theirs = context.Pipe()
            self._plant, last_words = context.Pipe(duplex=False)
            self._server = context.Process(
                target=serve, args=(to_json(scenario), _environment(), theirs, last_words)
            )
            with without_main():
                self._server.start()
        except (OSError, MemoryError, EOFError) as error:
            # EOFError: what loads the libraries died of it, and told the launcher's terminal why.
            reason = getattr(error, "strerror", None) or error
            raise EngineError(f"no program can be started: {reason}") from error
        theirs.close()
        last_words.close()
        self._programs: dict[str, Program] = {}
        self._logs = Path()
        self.last_words: Summary | str = ""
        """What the plant said at its end: its summary, or why there is none."""
        self._pids: dict[str, int] = {}
        self._exits: dict[str, int] = {}
        """Exit codes of the programs that have ended; negative: the signal."""
        self._killed: set[str] = set()
        self._held: Set[str] = frozenset()
        """Programs that are stopped."""
        self._served = False
        """Whether reports may still come."""

    def require_runnable(self) -> None:
        """Return when the theory is known to hold at x(0).

        Raises as phalanx.swarm.runnable.require_runnable, and EngineError.
        """
        try:
            while not self._reports.poll(_GLANCE):
                interrupt.raise_unanswered()
            refusal: Exception | None = self._reports.recv()
        except EOFError:
            self._server.join()
            raise EngineError(_how("the fork server", self._server.exitcode or 0)) from None
        if refusal is not None:
            raise refusal

    def start(self, membership: Membership, programs: Sequence[Program], logs: Path) -> None:
        """Start the programs, the plant first. Raises OSError."""
        logs.mkdir(exist_ok=True)
        self._programs = {program.identity: program for program in programs}
        self._logs, self._served = logs, True
        # If it died, that is found out when it is waited for.
        with contextlib.suppress(BrokenPipeError):
            self._reports.send(Order(membership, programs, logs))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    @property
    def plant_runs(self) -> bool:
        """Whether the plant is alive, or has yet to start."""
        self._take_reports(0.0)
        return self._served and PLANT not in self._exits

    def restart(self, identity: str) -> None:
        """Have a program that was killed started again; may be called from another thread."""
        if self._exits.pop(identity, None) is not None:
            self._reports.send(identity)

    def hold(self, identities: Set[str]) -> None:
        """Hold these programs by SIGSTOP, and no others; may be called from another thread.

        After a while each goes on, held or not.
        """
        for identity in self._held - identities:
            self._signal(identity, signal.SIGCONT)
        for identity in identities - self._held:
            self._signal(identity, signal.SIGSTOP)
            limit = threading.Timer(_LONGEST_STOP, self._signal, [identity, signal.SIGCONT])
            limit.daemon = True
            limit.start()
        self._held = identities

    def _signal(self, identity: str, number: signal.Signals) -> None:
        if identity in self._pids and identity not in self._exits:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pids[identity], number)

    # Of two Ctrl-C the second must not break into what the first is answered by.
    @interrupt.held_back()
    def wait_for_plant(self) -> None:
        """Return when the plant has ended. Ctrl-C asks it to stop, the next one ends it at once.

        The plant sees an agent die by its liveliness token; one that fails before it joins, and so
        has none, is told of.
        """
        told, asked = False, math.inf
        while self.plant_runs:
            try:
                interrupt.raise_unanswered()
                if not told and any(map(self._failed, self._exits)):
                    self._await_plant(_NOTICE)
                    told = self._signal_plant(signal.SIGUSR1)
                elif time.monotonic() > asked + _LONGEST_END:
                    raise KeyboardInterrupt  # as if somebody had lost patience
                else:
                    self._take_reports(_GLANCE)
            except KeyboardInterrupt:
                interrupt.answer()
                again = time.monotonic() > asked + _AGAIN
                if not self._signal_plant(signal.SIGABRT if again else signal.SIGTERM):
                    raise
                asked = math.inf if again else min(asked, time.monotonic())

    def first_failure(self) -> str:
        """Which program died first, how, and the last line it wrote; empty if none died.

        Those that were killed because they would not leave do not count.
        """
        for name, program in self._programs.items():
            code = self._exits.get(name)
            if code is None or code in _VERDICTS or name in self._killed:
                continue
            return self._death(program.title, code, f"{name}.log", name == PLANT)
        if self._server.exitcode:
            return self._death("the fork server", self._server.exitcode, LOG)
        return ""

    @interrupt.held_back()
    def end(self) -> None:
        """Leave no process behind: give the agents time to notice, then kill."""
        if not self._programs or (self.plant_runs and not self._signal_plant(signal.SIGTERM)):
            self._end_server()
        deadline = time.monotonic() + _GRACE
        while self._served and (left := deadline - time.monotonic()) > 0:
            self._take_reports(left)
        self._killed = set(self._pids) - set(self._exits)
        if self._served:
            self._end_server()
        self._server.join()
        for name in self._killed:
            # The fork server does it, unless it was killed itself.
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._pids[name], signal.SIGKILL)
        self._pids.clear()  # the system gives them to others

    def _end_server(self) -> None:
        """Have the fork server kill what it has forked, and end."""
        if self._server.is_alive() and self._server.pid:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._server.pid, signal.SIGUSR1)

    def _take_reports(self, timeout: float | None) -> None:
        """Take what has been reported, waiting for the first report if there is none."""
        try:
            while ready := wait([self._plant, self._reports], timeout):
                timeout = 0.0
                if self._plant in ready:
                    # At its end when all programs are gone: how they ended is in the reports.
                    with contextlib.suppress(EOFError, OSError):
                        self.last_words = self._plant.recv()
                if self._reports in ready:
                    self._take(self._reports.recv())
        except EOFError:
            self._served = False

    def _take(self, report: Report) -> None:
        self._pids[report.identity] = report.pid
        if report.exit_code is not None:
            self._exits[report.identity] = report.exit_code

    def _await_plant(self, timeout: float) -> None:
        deadline = time.monotonic() + timeout
        while self.plant_runs and (left := deadline - time.monotonic()) > 0:
            self._take_reports(left)

    def _signal_plant(self, number: signal.Signals) -> bool:
        """Send the plant a signal if it has started and not ended; whether it has started."""
        if self.plant_runs and PLANT in self._pids:
            with contextlib.suppress(ProcessLookupError):  # its end is not reported yet
                os.kill(self._pids[PLANT], number)
        return PLANT in self._pids

    def _failed(self, name: str) -> bool:
        """Whether an agent ended with an error of its own; a kill may be part of the run."""
        code = self._exits[name]
        return name != PLANT and code > 0 and code not in _VERDICTS

    def _death(self, title: str, code: int, log_name: str, plant: bool = False) -> str:
        log = self._logs / log_name
        text = log.read_text(errors="replace") if log.exists() else ""
        # The traceback of a crash is for readers of the log.
        lines = text.partition(_CRASHED)[0].strip().splitlines()
        # On a full disk there may be no log.
        said = self.last_words if plant and isinstance(self.last_words, str) else ""
        last = said or "".join(lines[-1:])
        return f"{_how(title, code)}{last and f': {last}'}; log: {log}"


def _how(title: str, code: int) -> str:
    """That a program died, and by what exit code; negative: the signal."""
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
    return f"{title} died ({how})"
