"""The processes of one run on this machine: started, watched, and never left behind."""

import multiprocessing
import multiprocessing.connection
import os
import signal
import time
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from phalanx.guarantee.verdict import Outcome, exit_status
from phalanx.launcher.programs import start_program
from phalanx.scenario.load import to_json
from phalanx.scenario.model import Scenario

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

    def __init__(self, scenario: Scenario, logs: Path) -> None:
        self._scenario = to_json(scenario)
        self._logs = logs
        self._logs.mkdir(exist_ok=True)
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(_PRELOAD)
        self._running: dict[str, BaseProcess] = {}
        self._killed: set[str] = set()

    def start(self, program: str, name: str, interruptible: bool, options: dict[str, Any]) -> None:
        """Start a program; its log is <name>.log."""
        process = self._context.Process(
            target=start_program,
            name=f"phx-{program}-{name}" if program != name else f"phx-{name}",
            args=(program, self._scenario, self._log(name), interruptible, options),
        )
        process.start()
        self._running[name] = process

    @property
    def plant_runs(self) -> bool:
        """Whether the plant is alive."""
        return self._running["plant"].is_alive()

    def wait_for_plant(self) -> None:
        """Return when the plant has ended. Ctrl-C asks it to stop, and waits on.

        The plant sees an agent die by its liveliness token; one that fails before it joins, and so
        has none, is told of.
        """
        plant = self._running["plant"]
        agents: dict[Any, BaseProcess] = {
            p.sentinel: p for name, p in self._running.items() if name not in ("plant", "viewer")
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
        plant = self._running.get("plant")
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

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"
