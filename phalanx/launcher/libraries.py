"""Load the programs' libraries in a process of their own, and raise the limit of file handles.

Nothing here takes long to import, so that loading can begin before anything else.
"""

import contextlib
import errno
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import resource
import signal
import sys
from multiprocessing.context import ForkServerContext

from phalanx.launcher.forkserver import importing_as_here

_PROGRAMS = ["phalanx.launcher.fork_server", "phalanx_plant.main", "phalanx_agent.main"]
"""Modules that have imported all that a run needs but the scenario's own code."""

_ENOUGH_HANDLES = 4096
"""File handles for the largest swarm and its viewers: the plant has one for each connection."""
_OWN_HANDLES = 40
"""File handles of the plant without agents: 29 were counted."""


def start_loading() -> ForkServerContext:
    """Start the process that loads the libraries, unless it runs already; return at once.

    Raises OSError if no folder for temporary files is writable.
    """
    _raise_limit()
    context = multiprocessing.get_context("forkserver")
    # A Python that ignores its environment would import others: see importing_as_here.
    context.set_forkserver_preload([] if sys.flags.ignore_environment else _PROGRAMS)
    # Starting it later would unblock SIGINT again.
    multiprocessing.resource_tracker.ensure_running()
    # Programs inherit the mask: a Ctrl-C before their handlers are set would end each of them in a
    # traceback, and a SIGTERM to the whole group or service without a verdict.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        with importing_as_here():
            multiprocessing.forkserver.ensure_running()
        return context
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _raise_limit() -> None:
    """Raise the limit of file handles of this process and its children, if the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _ENOUGH_HANDLES if hard == resource.RLIM_INFINITY else min(hard, _ENOUGH_HANDLES)
    if resource.RLIM_INFINITY != soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def require_handles(programs: int) -> None:
    """Raise OSError if the plant would run out of file handles with this many agent programs."""
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _OWN_HANDLES + programs
    if resource.RLIM_INFINITY != allowed < needed:
        raise OSError(
            errno.EMFILE,
            f"a process may have {allowed} file handles, and the plant of this swarm needs "
            f"{needed}: raise the hard limit (ulimit -Hn), or take --engine in-process",
        )
