"""The programs of a run, by name, and how each is run in a process of its own."""

import contextlib
import logging
import multiprocessing
import os
import pkgutil
import signal
import sys
from pathlib import Path
from typing import Any

from phalanx.scenario.fields import CONTROLLER
from phalanx.scenario.load import from_json
from phalanx.scenario.model import Scenario
from phalanx.wire.membership import Membership

PROGRAMS = {
    "plant": "phalanx.plant.main:run",
    "agent": "phalanx.agent.main:run",
    CONTROLLER: "phalanx.agent.main:run",
    "viewer": "phalanx.viewer.main:run_live",
}
"""The programs by name; resolved where they run, so that nothing here imports them."""


def start_program(
    program: str,
    scenario: str,
    membership: Membership,
    log_file: Path,
    options: dict[str, Any],
) -> None:
    """Run one program in this process until it ends; everything it prints goes to its log."""
    with contextlib.suppress(OSError):
        # What ps and top show; the kernel keeps 15 bytes.
        Path("/proc/self/comm").write_text(multiprocessing.current_process().name)
    log = os.open(log_file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(log, sys.stdout.fileno())
    os.dup2(log, sys.stderr.fileno())
    os.close(log)
    if program != "plant":
        # Ctrl-C reaches the whole terminal; only the plant decides what it means.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    configure_logging()
    sys.exit(run_program(program, from_json(scenario), membership, options))


def run_program(
    program: str, scenario: Scenario, membership: Membership, options: dict[str, Any]
) -> int:
    """Run one program in this process; its exit status."""
    run = pkgutil.resolve_name(PROGRAMS[program])
    status: int = run(scenario, membership, **options)
    return status


def configure_logging() -> None:
    """Log to standard error, each line with its wall time."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
