"""Real runs: real processes, a real hub on a free port, and a hunt for orphans afterwards."""

import contextlib
import os
import subprocess
import sys
import uuid
from collections.abc import Callable
from pathlib import Path

import psutil

from tests.process.runs import wait_for

MARK = "PHALANX_TEST_RUN"

LONG = ("--set", "duration=500")
"""A run that does not end by itself while a test waits."""
PATIENCE = 60.0
"""Within this time every process of a run that is over ends, on busy cores too [s]."""


class Run:
    """One `phalanx` command with everything it started."""

    def __init__(self, folder: Path, *arguments: str, limit: Callable[[], None] | None = None):
        self.parent = folder
        self.mark = uuid.uuid4().hex
        command = [sys.executable, "-m", "phalanx", *arguments]
        if arguments[0] == "run":
            command += ["--no-report", "--out", str(folder)]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, MARK: self.mark, "COLUMNS": "200"},
            start_new_session=True,
            preexec_fn=limit,
        )

    @property
    def folder(self) -> Path:
        """The run's folder, once it is there."""
        return wait_for(lambda: next(iter(self.parent.glob("*-[0-9]*")), None))

    def finish(self, timeout: float = 150) -> tuple[int, str]:
        """Exit status, and everything it printed; the timeout [s] is for busy cores."""
        out, err = self.process.communicate(timeout=timeout)
        return self.process.returncode, err + out

    def ends(self, status: int) -> str:
        """Everything it printed, once it ended with this status and left no process."""
        actual, printed = self.finish()
        assert actual == status, printed
        self.wait_until_gone()
        return printed

    def programs(self) -> dict[str, psutil.Process]:
        """The plant and the agents that run now, by the name that ps shows."""
        programs = {}
        for process in self.descendants():
            try:
                if process.name().startswith("phx-"):
                    programs[process.name()] = process
            except psutil.NoSuchProcess:
                continue
        return programs

    def descendants(self) -> list[psutil.Process]:
        """Every living process that this command started, however far removed."""
        processes = []
        for process in psutil.process_iter():
            try:
                alive = process.status() != psutil.STATUS_ZOMBIE
                if alive and process.environ().get(MARK) == self.mark:
                    processes.append(process)
            except (psutil.NoSuchProcess, psutil.AccessDenied):
                continue
        return processes

    def wait_until_running(self, agents: int = 5, bytes_recorded: int = 100_000) -> None:
        """Return in the middle of the run: all programs there, and something recorded."""
        wait_for(lambda: len(self.programs()) == agents + 1)
        recording = self.folder / "recording.mcap"
        wait_for(lambda: recording.exists() and recording.stat().st_size > bytes_recorded)

    def wait_until_gone(self) -> None:
        """Fail unless every process ends, long before a run of LONG could by itself."""
        wait_for(lambda: not self.descendants(), PATIENCE)

    def kill_all(self) -> None:
        """Leave nothing behind, whatever the test did."""
        for process in self.descendants():
            with contextlib.suppress(psutil.NoSuchProcess):  # it may end by itself meanwhile
                process.kill()
        self.process.communicate()
