"""The process that loads what programs are, while the one that wants them does other things.

Nothing here takes long to import, so that it can be asked for before anything else.
"""

import contextlib
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import os
import signal
import sys
import threading
import types
from collections.abc import Iterator
from multiprocessing.context import ForkServerContext

from phalanx.launcher.handles import raise_limit

_PROGRAMS = ["phalanx.launcher.fork_server", "phalanx.plant.main", "phalanx.agent.main"]
"""Modules that have imported all that a run needs but the scenario's own code."""
_changing_environment = threading.Lock()


def start_loading() -> ForkServerContext:
    """Start the process that loads the libraries, unless it runs already.

    It does so while the caller goes on, so the sooner it is asked for the better. Raises OSError
    where no folder for temporary files can be written to.
    """
    raise_limit()
    context = multiprocessing.get_context("forkserver")
    # A Python that heeds no environment would take them from elsewhere: see _importing_as_here.
    context.set_forkserver_preload([] if sys.flags.ignore_environment else _PROGRAMS)
    # Where it has to be started, it unblocks SIGINT for whatever comes after it.
    multiprocessing.resource_tracker.ensure_running()
    with _interrupts_held_back(), _importing_as_here():
        # Programs inherit the mask: a Ctrl-C that comes before they are ready for it would end each
        # of them in a traceback; a SIGTERM to all of a group or a service, without a verdict.
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
def _importing_as_here() -> Iterator[None]:
    """Have a Python that is started meanwhile import what this one does.

    multiprocessing tells its server of sys.path only when it has loaded what it was to load ahead,
    out of the working directory before all else: another phalanx may lie there.
    """
    # What is no text is passed over by import too.
    path = os.pathsep.join(os.path.abspath(entry) for entry in sys.path if isinstance(entry, str))
    with _changing_environment:
        before = {name: os.environ.pop(name, None) for name in ("PYTHONPATH", "PYTHONSAFEPATH")}
        os.environ.update(PYTHONPATH=path, PYTHONSAFEPATH="1")
        try:
            yield
        finally:
            for name, value in before.items():
                del os.environ[name]
                if value is not None:
                    os.environ[name] = value


@contextlib.contextmanager
def _interrupts_held_back() -> Iterator[None]:
    """Block SIGINT and SIGTERM for this thread and for whatever it starts meanwhile."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
