"""Starting the process that loads what programs are, and the file handles that they will need.

Nothing here takes long to import, so that it can be asked for before anything else.
"""

import contextlib
import errno
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import resource
import signal
import sys
from collections.abc import Iterator
from multiprocessing.context import ForkServerContext

from phalanx.compat.forkserver import importing_as_here

_PROGRAMS = ["phalanx.launcher.fork_server", "phalanx_plant.main", "phalanx_agent.main"]
"""Modules that have imported all that a run needs but the scenario's own code."""

_ENOUGH_HANDLES = 4096
"""File handles for the largest swarm and its viewers: the plant has one for each connection."""
_OWN_HANDLES = 40
"""Of the plant without agents: 29 were counted."""


def start_loading() -> ForkServerContext:
    """Start the process that loads the libraries, unless it runs already.

    It does so while the caller goes on, so the sooner it is asked for the better. Raises OSError
    where no folder for temporary files can be written to.
    """
    _raise_limit()
    context = multiprocessing.get_context("forkserver")
    # A Python that heeds no environment would take them from elsewhere: see importing_as_here.
    context.set_forkserver_preload([] if sys.flags.ignore_environment else _PROGRAMS)
    # Where it has to be started, it unblocks SIGINT for whatever comes after it.
    multiprocessing.resource_tracker.ensure_running()
    with _interrupts_held_back(), importing_as_here():
        # Programs inherit the mask: a Ctrl-C that comes before they are ready for it would end each
        # of them in a traceback; a SIGTERM to all of a group or a service, without a verdict.
        multiprocessing.forkserver.ensure_running()
    return context


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Block SIGINT and SIGTERM for this thread and for whatever it starts meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _raise_limit() -> None:
    """Let this process, and what it starts, have as many handles as are enough, if it may."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _ENOUGH_HANDLES if hard == resource.RLIM_INFINITY else min(hard, _ENOUGH_HANDLES)
    if resource.RLIM_INFINITY != soft < wanted:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))


def require_handles(programs: int) -> None:
    """Raise OSError if the plant would run out of handles with so many agents' programs."""
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _OWN_HANDLES + programs
    if resource.RLIM_INFINITY != allowed < needed:
        raise OSError(
            errno.EMFILE,
            f"a process may have {allowed} file handles, and the plant of this swarm needs "
            f"{needed}: raise the hard limit (ulimit -Hn), or take --engine in-process",
        )
