"""The programs of a run by name, and how to run one in this process."""

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
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.schema.fields import CONTROLLER
from phalanx.swarm.rows import SafetyRows

log = logging.getLogger("phalanx.launcher")

PROGRAMS = _PLANT, _AGENT = "phalanx_plant.main:run", "phalanx_agent.main:run"
_TOGETHER = "phalanx_agent.main:run_together"
"""The programs, imported where they run, and not here."""

_GRACE, _GRACE_OF_PLANT = 2.5, 4.0
"""Time for programs to end without their launcher [s]: the plant finishes its recording."""


class Program(NamedTuple):
    """A program of a run to start."""

    identity: str
    """Its name in the run; its log is <identity>.log."""
    options: Mapping[str, Any] = {}
    others: tuple[str, ...] = ()
    """Further agents in the same process."""

    @property
    def title(self) -> str:
        """Its name in ps and top."""
        prefix = "phx" if self.identity in (PLANT, CONTROLLER) else "phx-agent"
        return f"{prefix}-{self.identity}"


def load_programs() -> None:
    """Import all programs."""
    for program in PROGRAMS:
        pkgutil.resolve_name(program)


def start_program(program: Program, rows: SafetyRows, membership: Membership, logs: Path) -> int:
    """Run one program in this process, its output in its log, and return its exit status."""
    multiprocessing.current_process().name = program.title
    show_as(program.title)
    redirect_output(logs / f"{program.identity}.log")
    faulthandler.enable()  # the log of a crash has its traceback
    plant = program.identity == PLANT
    if not plant:
        # Ctrl-C reaches the whole terminal, SIGTERM may reach a whole service, and stays blocked:
        # the plant alone reacts to them.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    end_with_launcher(_GRACE_OF_PLANT if plant else _GRACE)
    own, *others = (
        membership.of(name, rows.swarm.programs.get(name, ()), rows.swarm.names)
        for name in (program.identity, *program.others)
    )
    if others:
        together: int = pkgutil.resolve_name(_TOGETHER)(rows, [own, *others], **program.options)
        return together
    return run_program(rows, own, program.options)


def run_program(rows: SafetyRows, membership: Membership, options: Mapping[str, Any]) -> int:
    """Run the membership's program in this process, and return its exit status."""
    program = _PLANT if membership.identity == PLANT else _AGENT
    status: int = pkgutil.resolve_name(program)(rows, membership, **options)
    return status


def end_with_launcher(grace: float) -> None:
    """End this process at most `grace` seconds after its launcher, in any state."""
    launcher = multiprocessing.parent_process()
    if launcher is None:
        return
    # Not multiprocessing's own wait, for the reason in show_as.
    death = select.poll()
    death.register(launcher.sentinel, select.POLLIN)

    def watch() -> None:
        death.poll()
        time.sleep(grace)
        log.error("the launcher died")
        os._exit(3)

    threading.Thread(target=watch, daemon=True).start()


def show_as(title: str) -> None:
    """Set the title that ps and top show; the kernel keeps 15 bytes."""
    # Not open(): it writes to more memory, and a forked process copies each page it writes to.
    with contextlib.suppress(OSError):
        name = os.open("/proc/self/comm", os.O_WRONLY)
        os.write(name, title.encode())
        os.close(name)


def redirect_output(log: Path) -> None:
    """Append this process's output and errors to a file, which only its user may read."""
    file = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
    os.dup2(file, sys.stdout.fileno())
    os.dup2(file, sys.stderr.fileno())
    os.close(file)


def configure_logging() -> None:
    """Log to standard error, each line with its wall time."""
    handler = logging.StreamHandler()
    handler.setFormatter(PrintableFormatter("%(asctime)s %(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
