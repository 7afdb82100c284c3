"""The programs of a run, by name, and how each is run in a process of its own."""

import contextlib
import faulthandler
import logging
import multiprocessing
import os
import pkgutil
import select
import signal
import sys
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from phalanx.launcher.streams import PrintableFormatter
from phalanx.schema.fields import CONTROLLER
from phalanx.swarm.rows import SafetyRows
from phalanx.wire.membership import Membership

log = logging.getLogger("phalanx.launcher")

PROGRAMS = {
    "plant": "phalanx_plant.main:run",
    "agent": "phalanx_agent.main:run",
    CONTROLLER: "phalanx_agent.main:run",
}
"""The programs by name; resolved where they run, so that nothing here imports them."""


_GRACE, _GRACE_OF_PLANT = 2.5, 4.0
"""How long programs may live without their launcher [s]: the plant writes a recording down."""


class Program(NamedTuple):
    """One program of a run, to be started."""

    kind: str
    """One of PROGRAMS."""
    identity: str
    """Its name in the run; its log is <identity>.log."""
    options: Mapping[str, Any] = {}

    @property
    def title(self) -> str:
        """What ps and top show."""
        name = self.kind if self.kind == self.identity else f"{self.kind}-{self.identity}"
        return f"phx-{name}"


def load_programs() -> None:
    """Import what the programs are."""
    for program in PROGRAMS.values():
        pkgutil.resolve_name(program)


def start_program(program: Program, rows: SafetyRows, membership: Membership, logs: Path) -> int:
    """Run one program in this process, where logging is set up, until it ends.

    Everything it prints goes to its log. Returns its exit status.
    """
    multiprocessing.current_process().name = program.title
    show_as(program.title)
    redirect_output(logs / f"{program.identity}.log")
    faulthandler.enable()  # of a crash the log says where it was
    if program.kind != "plant":
        # Ctrl-C reaches the whole terminal, SIGTERM may reach a whole service, and is left blocked:
        # only the plant decides what they mean.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    end_with_launcher(_GRACE_OF_PLANT if program.kind == "plant" else _GRACE)
    decides_for = rows.swarm.programs.get(program.identity, ())
    own = membership.of(program.identity, decides_for, rows.swarm.names)
    return run_program(program.kind, rows, own, program.options)


def run_program(
    kind: str, rows: SafetyRows, membership: Membership, options: Mapping[str, Any]
) -> int:
    """Run one program in this process; its exit status."""
    status: int = pkgutil.resolve_name(PROGRAMS[kind])(rows, membership, **options)
    return status


def end_with_launcher(grace: float) -> None:
    """End this process at most `grace` seconds after its launcher, whatever it is doing then."""
    launcher = multiprocessing.parent_process()
    if launcher is None:
        return
    # Not multiprocessing's own wait: see show_as.
    death = select.poll()
    death.register(launcher.sentinel, select.POLLIN)

    def watch() -> None:
        death.poll()
        time.sleep(grace)
        log.error("the launcher died")
        os._exit(3)

    threading.Thread(target=watch, daemon=True).start()


def show_as(title: str) -> None:
    """Have ps and top show this title; the kernel keeps 15 bytes."""
    # Not open(): a forked program has its first pages to copy for what that goes through.
    with contextlib.suppress(OSError):
        name = os.open("/proc/self/comm", os.O_WRONLY)
        os.write(name, title.encode())
        os.close(name)


def redirect_output(log: Path) -> None:
    """Append all that this process prints to a file."""
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    os.dup2(file, sys.stdout.fileno())
    os.dup2(file, sys.stderr.fileno())
    os.close(file)


def configure_logging() -> None:
    """Log to standard error, each line with its wall time."""
    handler = logging.StreamHandler()
    handler.setFormatter(PrintableFormatter("%(asctime)s %(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
