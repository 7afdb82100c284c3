"""Start processes that have the programs' libraries, and raise the limit of file handles.

multiprocessing's fork server loads them once. Nothing here takes long to import, so that loading
can begin before anything else. Three workarounds:

`_importing_as_here`: before Python 3.12.8 and 3.13.1 the server ignores sys.path while it preloads
(python/cpython#117378), and searches the working directory first, where another phalanx may be.
It can be removed when `requires-python` excludes those.

`_without_main`: multiprocessing imports the caller's `__main__` in each process that it starts, and
has no option against it. Upstream has no issue yet. Its text: "A Process whose target is in an
importable module should be able to refuse the import of `__main__`; scripts without a main guard
run again in it."

`end_fork_server`: until a killed server is a zombie, multiprocessing takes it for alive. Upstream
has no issue yet.
"""

import contextlib
import errno
import multiprocessing
import multiprocessing.forkserver
import multiprocessing.resource_tracker
import os
import resource
import signal
import sys
import threading
import types
from collections.abc import Callable, Iterator
from multiprocessing.process import BaseProcess
from typing import Any

_PROGRAMS = ["phalanx.launcher.fork_server", "phalanx_plant.main", "phalanx_agent.main"]
"""Modules that have imported all that a run needs but the scenario's own code."""

_ENOUGH_HANDLES = 4096
"""File handles for the largest swarm and its viewers: the plant has one for each connection."""
_HANDLES_OF_PLANT = 40
"""File handles of the plant without agents: 29 were counted."""

_changing_environment = threading.Lock()


def start_loading() -> None:
    """Start the process that loads the libraries, unless it runs already; return at once.

    Raises OSError if no folder for temporary files is writable.
    """
    _raise_limit()
    # A Python that ignores its environment would import others: see _importing_as_here.
    modules = [] if sys.flags.ignore_environment else _PROGRAMS
    multiprocessing.forkserver.set_forkserver_preload(modules)
    # Starting it later would unblock SIGINT again.
    multiprocessing.resource_tracker.ensure_running()
    # Programs inherit the mask: a Ctrl-C before their handlers are set would end each of them in a
    # traceback, and a SIGTERM to the whole group or service without a verdict.
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        with _importing_as_here():
            multiprocessing.forkserver.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start_process(
    target: Callable[..., None], *arguments: object, daemon: bool = False
) -> BaseProcess:
    """Call a function in a new process that has the libraries; SIGINT and SIGTERM are blocked.

    Raises OSError, and EOFError if the process that loads the libraries died.
    """
    start_loading()
    context = multiprocessing.get_context("forkserver")
    process = context.Process(target=target, args=arguments, daemon=daemon)
    with _without_main():
        process.start()
    return process


def end_fork_server() -> None:
    """Kill the fork server and await its death: the next start makes another."""
    server: Any = multiprocessing.forkserver._forkserver
    if server._forkserver_pid is not None:
        os.kill(server._forkserver_pid, signal.SIGKILL)
        if hasattr(os, "waitid"):  # not in macOS before Python 3.13: the next start may then fail
            os.waitid(os.P_PID, server._forkserver_pid, os.WEXITED | os.WNOWAIT)


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Keep multiprocessing from importing the caller's script in a process that it starts."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


@contextlib.contextmanager
def _importing_as_here() -> Iterator[None]:
    """Let a Python that is started in the block import from the same path as this one."""
    # import, too, ignores entries that are not texts.
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


def _raise_limit() -> None:
    """Raise the limit of file handles of this process and its children, if the system allows."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    enough = _ENOUGH_HANDLES if hard == resource.RLIM_INFINITY else min(hard, _ENOUGH_HANDLES)
    if resource.RLIM_INFINITY != soft < enough:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (enough, hard))


def require_handles(programs: int) -> None:
    """Raise OSError if the plant would run out of file handles with this many agent programs."""
    _raise_limit()
    allowed, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = _HANDLES_OF_PLANT + programs
    if resource.RLIM_INFINITY != allowed < needed:
        raise OSError(
            errno.EMFILE,
            f"a process may have {allowed} file handles, and the plant of this swarm needs "
            f"{needed}: raise the hard limit (ulimit -Hn), or take --engine in-process",
        )
