"""Launch a run on this machine: the plant and every agent, each in a process of its own.

The launcher only starts and watches. Programs talk to each other over Zenoh alone, and each stops
by itself: agents when the hub is gone, the plant when it is done, told to, or left alone.
"""

import contextlib
import secrets
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from phalanx.faults.commands import NO_COMMANDS, CommandPolicy
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.launcher.processes import Processes
from phalanx.recording.records import SUMMARY
from phalanx.scenario.fields import CONTROLLER
from phalanx.scenario.model import Scenario
from phalanx.wire.keys import Keys
from phalanx.wire.messages import Ended, Malformed, Sealer, Status
from phalanx.wire.session import HubError, open_client, subscribe

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
    policy: CommandPolicy = NO_COMMANDS,
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
        policy: who may interfere from outside the scenario, and what is to happen anyway.
        viewer: start one too, with these options of viewer.main.run; it ends with the run.

    Returns:
        The plant's summary.

    Raises:
        LaunchError: the plant died and there is no verdict.
    """
    run_id, secret = folder.name, secret or secrets.token_bytes(16)
    common = {"run_id": run_id, "endpoint": endpoint, "secret": secret}
    plant = {**common, "folder": folder, "policy": policy}
    swarm = Processes(scenario, folder / "logs")
    try:
        swarm.start("plant", "plant", interruptible=True, options=plant)
        for name in scenario.programs():
            program = CONTROLLER if name == CONTROLLER else "agent"
            options = {**common, "name": name, "timeout": timeout}
            swarm.start(program, name, interruptible=False, options=options)
        if viewer is not None:
            options = {**common, "control": policy.secret, **viewer}
            swarm.start("viewer", "viewer", interruptible=False, options=options)
        verdict = _Verdict(folder)
        with _listening(run_id, endpoint, secret, swarm, report, verdict):
            swarm.wait_for_plant()
    finally:
        swarm.end()
    summary = verdict.read()
    first_failure = swarm.first_failure()
    if summary is None:
        raise LaunchError(first_failure or "the plant ended without a verdict")
    if summary.outcome is Outcome.BROKEN and first_failure:
        summary.reason = f"{summary.reason} [{first_failure}]"
    return summary


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
    swarm: Processes,
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
