"""The process that loads what programs are, while the one that wants them does other things.

Nothing here takes long to import, so that it can be asked for before anything else.
"""

import contextlib
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import signal
import sys
import types
from collections.abc import Iterator
from multiprocessing.context import ForkServerContext

_PROGRAMS = ["phalanx.launcher.fork_server", "phalanx.plant.main", "phalanx.agent.main"]
"""Modules that have imported all that a run needs but the scenario's own code."""


def start_loading() -> ForkServerContext:
    """Start the process that loads the libraries, unless it runs already.

    It does so while the caller goes on, so the sooner it is asked for the better. Raises OSError
    where no folder for temporary files can be written to.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PROGRAMS)
    # Where it has to be started, it unblocks SIGINT for whatever comes after it.
    multiprocessing.resource_tracker.ensure_running()
    with _interrupts_held_back():
        # Programs inherit the mask: a Ctrl-C that comes before they are ready for it would
        # end each of them in a traceback.
        multiprocessing.forkserver.ensure_running()
    return context


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Keep multiprocessing from importing the caller's script in the process it starts.

    The programs need nothing of it, and a script without a main guard would run again there.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Block SIGINT for this thread and for whatever it starts meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
