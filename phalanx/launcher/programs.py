"""The programs of a run by name, and how to run one in this process."""

import contextlib
import faulthandler
import logging
import os
import pkgutil
import signal
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from phalanx.launcher.streams import PrintableFormatter
from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.schema.fields import CONTROLLER
from phalanx.swarm.child import end_with_parent
from phalanx.swarm.rows import SafetyRows

PROGRAMS = _PLANT, _AGENT = "phalanx_plant.main:run", "phalanx_agent.main:run"
"""The programs, imported where they run, and not here."""


class Program(NamedTuple):
    """A program of a run to start."""

    identity: str
    """Its name in the run; its log is <identity>.log."""
    options: Mapping[str, Any] = {}

    @property
    def title(self) -> str:
        """Its name in ps and top."""
        prefix = "phx" if self.identity in (PLANT, CONTROLLER) else "phx-agent"
        return f"{prefix}-{self.identity}"


def load_programs() -> None:
    """Import all programs."""
    for program in PROGRAMS:
        pkgutil.resolve_name(program)


def run_child(program: Program, rows: SafetyRows, membership: Membership, logs: Path) -> NoReturn:
    """Run one program in this forked process, its output in its log, and exit with its status."""
    status = 1
    try:
        end_with_parent()
        show_as(program.title)
        redirect_output(logs / f"{program.identity}.log")
        faulthandler.enable()  # the log of a crash has its traceback
        if program.identity != PLANT:
            # Ctrl-C reaches the whole terminal, SIGTERM may reach a whole service, and stays
            # blocked: the plant alone reacts to them.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        served = rows.swarm.programs.get(program.identity, ())
        of_program = membership.of(program.identity, served, rows.swarm.names)
        status = run_program(rows, of_program, program.options)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # a thread of a user's code may never end


def run_program(rows: SafetyRows, membership: Membership, options: Mapping[str, Any]) -> int:
    """Run the membership's program in this process, and return its exit status."""
    program = _PLANT if membership.identity == PLANT else _AGENT
    status: int = pkgutil.resolve_name(program)(rows, membership, **options)
    return status


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
