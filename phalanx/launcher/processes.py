"""The processes of one run on this machine: started, watched, and never left behind."""

import contextlib
import multiprocessing
import multiprocessing.connection
import multiprocessing.forkserver
import os
import signal
import sys
import time
import types
from collections.abc import Iterator, Mapping
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from phalanx.guarantee.verdict import Outcome, exit_status
from phalanx.launcher.programs import start_program
from phalanx.scenario.load import to_json
from phalanx.scenario.model import Scenario
from phalanx.wire.keys import PLANT
from phalanx.wire.membership import Membership

_PRELOAD = [
    "casadi",
    "mcap.writer",
    "msgspec",
    "numpy",
    "osqp",
    "pydantic",
    "scipy.sparse",
    "zenoh",
]
_NOTICE = 1.0
"""How long the plant gets to see by itself that an agent failed [s]."""
_GRACE = 4.0
"""How long agents get to leave after the plant did [s]."""

_VERDICTS = {exit_status(outcome) for outcome in Outcome}


class Processes:
    """The programs of one run."""

    def __init__(self, scenario: Scenario, membership: Membership, logs: Path) -> None:
        self._scenario, self._membership = to_json(scenario), membership
        self._logs = logs
        self._logs.mkdir(exist_ok=True)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(_PRELOAD)
        self._running: dict[str, BaseProcess] = {}
        self._killed: set[str] = set()
        with _interrupts_held_back():
            # Programs inherit the mask: a Ctrl-C that comes before they are ready for it would
            # end each of them in a traceback.
            multiprocessing.forkserver.ensure_running()

    def start(self, program: str, identity: str, options: Mapping[str, Any] | None = None) -> None:
        """Start a program under its name in the run; its log is <name>.log."""
        process = self._context.Process(
            target=start_program,
            name=f"phx-{program}-{identity}" if program != identity else f"phx-{identity}",
            args=(
                program,
                self._scenario,
                self._membership.of(identity),
                self._log(identity),
                dict(options or {}),
            ),
        )
        with _without_main():
            process.start()
        self._running[identity] = process

    @property
    def plant_runs(self) -> bool:
        """Whether the plant is alive."""
        return self._running[PLANT].is_alive()

    def wait_for_plant(self) -> None:
        """Return when the plant has ended. Ctrl-C asks it to stop, and waits on.

        The plant sees an agent die by its liveliness token; one that fails before it joins, and so
        has none, is told of.
        """
        plant = self._running[PLANT]
        agents: dict[Any, BaseProcess] = {
            p.sentinel: p for name, p in self._running.items() if name not in (PLANT, "viewer")
        }
        while plant.is_alive():
            try:
                for ended in multiprocessing.connection.wait([plant.sentinel, *agents]):
                    agent = agents.pop(ended, None)
                    if agent is not None and self._failed(agent):
                        plant.join(_NOTICE)
                        if plant.is_alive() and plant.pid:
                            os.kill(plant.pid, signal.SIGUSR1)
            except KeyboardInterrupt:
                plant.terminate()

    def _failed(self, agent: BaseProcess) -> bool:
        """Whether it ended with an error of its own; a kill may be part of the run."""
        agent.join()
        return agent.exitcode is not None and agent.exitcode > 0 and agent.exitcode not in _VERDICTS

    def first_failure(self) -> str:
        """Which program died first, how, and the last line it wrote; empty if none died.

        Those that were killed because they would not leave do not count.
        """
        for name, process in self._running.items():
            code = process.exitcode
            if code is None or code in _VERDICTS or name in self._killed:
                continue
            how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"
            log = self._log(name)
            lines = log.read_text(errors="replace").strip().splitlines() if log.exists() else []
            last = f": {lines[-1]}" if lines else ""
            return f"{process.name} died ({how}){last}; log: {log}"
        return ""

    def end(self) -> None:
        """Leave no process behind: give the agents time to notice, then kill."""
        plant = self._running.get(PLANT)
        if plant is not None and plant.is_alive():
            plant.terminate()
        deadline = time.monotonic() + _GRACE
        for process in self._running.values():
            process.join(max(0.0, deadline - time.monotonic()))
        for name, process in self._running.items():
            if process.is_alive():
                self._killed.add(name)
                process.kill()
                process.join()

    def _log(self, identity: str) -> Path:
        return self._logs / f"{identity}.log"


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Keep multiprocessing from importing the caller's script in every process it starts.

    The programs need nothing of it, and a script without a main guard would run again in each.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Block SIGINT for this thread and for whatever it starts meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
