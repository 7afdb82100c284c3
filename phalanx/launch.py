"""Launch a run on this machine: the plant and every agent, each in a process of its own.

The launcher only starts and watches. Programs talk to each other over Zenoh alone, and each stops
by itself: agents when the hub is gone, the plant when it is done, told to, or left alone.
"""

import contextlib
import logging
import multiprocessing
import multiprocessing.connection
import os
import pkgutil
import secrets
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import msgspec

from phalanx.control import UNSTEERED, Steering
from phalanx.recording.records import SUMMARY
from phalanx.scenario.fields import CONTROLLER
from phalanx.scenario.load import from_json, to_json
from phalanx.scenario.model import Scenario
from phalanx.verdict import Outcome, Summary, exit_status
from phalanx.wire.keys import Keys
from phalanx.wire.messages import Ended, Malformed, Sealer, Status
from phalanx.wire.session import HubError, open_client, subscribe

PROGRAMS = {
    "plant": "plant.main:run",
    "agent": "agent.main:run",
    CONTROLLER: "agent.main:run",
    "viewer": "viewer.main:run",
    "export": "viewer.export:run",
}
"""The programs by name; resolved where they run, so that nothing here imports them."""

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
_GRACE = 4.0
"""How long agents get to leave after the plant did [s]."""

_VERDICTS = {exit_status(outcome) for outcome in Outcome}

Report = Callable[[Status], None]


class LaunchError(RuntimeError):
    """A program died before the run began, or without a verdict; the message says which and why."""


def new_folder(parent: Path, name: str) -> Path:
    """Create the next free folder <parent>/<name>-<n>. Raises OSError."""
    parent.mkdir(parents=True, exist_ok=True)
    n = 1
    while True:
        try:
            (folder := parent / f"{name}-{n}").mkdir()
            return folder
        except FileExistsError:
            n += 1


def launch(
    scenario: Scenario,
    folder: Path,
    endpoint: str,
    report: Report,
    secret: bytes = b"",
    timeout: float = 60.0,
    steering: Steering = UNSTEERED,
    viewer: Mapping[str, Any] | None = None,
) -> Summary:
    """Run a scenario to its verdict.

    Args:
        scenario: resolved.
        folder: of the run; logs, recording and summary go there.
        endpoint: Zenoh endpoint for the hub.
        report: called with the plant's progress.
        secret: seals the run's messages; drawn at random if empty.
        timeout: how long programs try to reach the hub [s].
        steering: who may interfere from outside the scenario, and what is to happen anyway.
        viewer: start one too, with these options of viewer.main.run; it ends with the run.

    Returns:
        The plant's summary.

    Raises:
        LaunchError: the plant died and there is no verdict.
    """
    run_id, secret = folder.name, secret or secrets.token_bytes(16)
    common = {"run_id": run_id, "endpoint": endpoint, "secret": secret}
    plant = {**common, "folder": folder, "steering": steering}
    swarm = _Processes(scenario, folder / "logs")
    try:
        swarm.start("plant", "plant", interruptible=True, options=plant)
        for name in scenario.programs():
            program = CONTROLLER if name == CONTROLLER else "agent"
            options = {**common, "name": name, "timeout": timeout}
            swarm.start(program, name, interruptible=False, options=options)
        if viewer is not None:
            options = {**common, "control": steering.secret, **viewer}
            swarm.start("viewer", "viewer", interruptible=False, options=options)
        verdict = _Verdict(folder)
        with _listening(run_id, endpoint, secret, swarm, report, verdict):
            swarm.wait_for_plant()
    finally:
        swarm.end()
    summary = verdict.read()
    obituary = swarm.obituary()
    if summary is None:
        raise LaunchError(obituary or "the plant ended without a verdict")
    if summary.outcome is Outcome.BROKEN and obituary:
        summary.reason = f"{summary.reason} [{obituary}]"
    return summary


def start_program(
    program: str, scenario: str, log_file: Path, interruptible: bool, options: dict[str, Any]
) -> None:
    """Run one program in this process until it ends; everything it prints goes to its log."""
    with contextlib.suppress(OSError):
        # What ps and top show; the kernel keeps 15 bytes.
        Path("/proc/self/comm").write_text(multiprocessing.current_process().name)
    log = os.open(log_file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(log, sys.stdout.fileno())
    os.dup2(log, sys.stderr.fileno())
    os.close(log)
    if not interruptible:
        # Ctrl-C reaches the whole terminal; only the plant decides what it means.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
    configure_logging()
    sys.exit(run_program(program, from_json(scenario), options))


def run_program(program: str, scenario: Scenario, options: dict[str, Any]) -> int:
    """Run one program in this process; its exit status."""
    run = pkgutil.resolve_name(PROGRAMS[program])
    status: int = run(scenario, **options)
    return status


def configure_logging() -> None:
    """Log to standard error, each line with its wall time."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")


class _Processes:
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
        """Return when the plant has ended. Ctrl-C asks it to stop, and waits on."""
        plant = self._running["plant"]
        while plant.is_alive():
            try:
                plant.join()
            except KeyboardInterrupt:
                plant.terminate()

    def obituary(self) -> str:
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


class _Verdict:
    """The plant's summary, as it comes: by message, and as a file unless the disk is full."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / SUMMARY
        self.message: bytes | None = None

    def read(self) -> Summary | None:
        """The summary, if there is one."""
        with contextlib.suppress(OSError, msgspec.DecodeError):
            return msgspec.json.decode(self._file.read_bytes(), type=Summary)
        return msgspec.json.decode(self.message, type=Summary) if self.message else None


@contextlib.contextmanager
def _listening(
    run_id: str,
    endpoint: str,
    secret: bytes,
    swarm: _Processes,
    report: Report,
    verdict: _Verdict,
) -> Iterator[None]:
    """Hand the plant's status and verdict messages on, while the block runs."""
    keys, sealer = Keys(run_id), Sealer(secret)

    def on_status(key: str, payload: bytes) -> None:
        with contextlib.suppress(Malformed):
            report(sealer.open(key, payload, Status))

    def on_verdict(key: str, payload: bytes) -> None:
        with contextlib.suppress(Malformed):
            verdict.message = sealer.open(key, payload, Ended).summary

    session = None
    while session is None and swarm.plant_runs:
        with contextlib.suppress(HubError):
            session = open_client(endpoint, timeout=0.5)
    if session is None:
        yield
        return
    with session:
        subscribe(session, keys.status, on_status)
        subscribe(session, keys.verdict, on_verdict)
        yield
