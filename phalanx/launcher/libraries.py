"""The process that loads what programs are, while the one that wants them does other things.

Nothing here takes long to import, so that it can be asked for before anything else.
"""

import contextlib
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import signal
import sys
from collections.abc import Iterator
from multiprocessing.context import ForkServerContext

from phalanx.compat.forkserver import importing_as_here
from phalanx.launcher.handles import raise_limit

_PROGRAMS = ["phalanx.launcher.fork_server", "phalanx_plant.main", "phalanx_agent.main"]
"""Modules that have imported all that a run needs but the scenario's own code."""


def start_loading() -> ForkServerContext:
    """Start the process that loads the libraries, unless it runs already.

    It does so while the caller goes on, so the sooner it is asked for the better. Raises OSError
    where no folder for temporary files can be written to.
    """
    raise_limit()
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
