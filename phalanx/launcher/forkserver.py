"""Start multiprocessing's fork server with this process's import path, and without its script.

`importing_as_here`: before Python 3.12.8 and 3.13.1 the server ignores sys.path while it preloads
(python/cpython#117378), and searches the working directory first, where another phalanx may be.
It can be removed when `requires-python` excludes those.

`without_main`: multiprocessing imports the caller's `__main__` in each process that it starts, and
has no option against it. Upstream has no issue yet. Its text: "A Process whose target is in an
importable module should be able to refuse the import of `__main__`; scripts without a main guard
run again in it."

`end_fork_server`: until a killed server is a zombie, multiprocessing takes it for alive. Upstream
has no issue yet.
"""

import contextlib
import multiprocessing.forkserver
import os
import signal
import sys
import threading
import types
from collections.abc import Iterator
from typing import Any

_changing_environment = threading.Lock()


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Keep multiprocessing from importing the caller's script in a process that it starts."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def end_fork_server() -> None:
    """Kill the fork server and await its death: the next start makes another."""
    server: Any = multiprocessing.forkserver._forkserver
    if server._forkserver_pid is not None:
        os.kill(server._forkserver_pid, signal.SIGKILL)
        os.waitid(os.P_PID, server._forkserver_pid, os.WEXITED | os.WNOWAIT)


@contextlib.contextmanager
def importing_as_here() -> Iterator[None]:
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
