"""A pool of worker processes: an Executor in which a worker's death costs one task, not all.

concurrent.futures fails every pending task when one of its processes dies. Here a thread waits for
each worker: only the task that it had fails, and the worker is replaced.
"""

import contextlib
import gc
import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, ParamSpec, TypeVar

from phalanx.launcher.libraries import end_fork_server, start_loading, start_process

P = ParamSpec("P")
T = TypeVar("T")


class WorkerDiedError(RuntimeError):
    """A task's worker ended before the task; the message says how."""


def _processors() -> int:
    """Return the number of processors that this process may use; Linux alone says which."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


class _Worker(NamedTuple):
    process: Any
    connection: Connection


class Pool(ThreadPoolExecutor):
    """Processes forked from one that has loaded the libraries; each has one task at a time."""

    def __init__(self, workers: int | None = None) -> None:
        """Begin with no worker; they start with the first tasks.

        workers: their number; by default that of the processors.
        """
        self.workers = workers or _processors()
        super().__init__(self.workers, "study-pool")
        start_loading()
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._lock, self._cancelled = threading.Lock(), False

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> "Future[T]":
        """Have a worker call a function; its exception, or WorkerDiedError, is the future's."""
        return super().submit(self._in_worker, pickle.dumps((fn, args, kwargs)))

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """Shut down; after an error the tasks are cancelled."""
        self.shutdown(cancel_futures=kind is not None)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the tasks end, unless they are to be cancelled: then end the workers at once."""
        if cancel_futures:
            with self._lock:
                self._cancelled = True
                for worker in self._busy:
                    worker.process.kill()
        super().shutdown(wait, cancel_futures=cancel_futures)
        for worker in self._idle:
            worker.connection.close()  # it ends by itself
        for worker in self._idle:
            worker.process.join()

    def _in_worker(self, work: bytes) -> Any:
        """Return the result of a pickled task, for which a thread of this process waits."""
        worker = self._take_worker()
        try:
            worker.connection.send_bytes(work)
            result, error = pickle.loads(worker.connection.recv_bytes())
        except (EOFError, OSError):
            worker.process.join()
            worker.connection.close()
            raise WorkerDiedError(_ending(worker.process.exitcode)) from None
        finally:
            with self._lock:
                self._busy.remove(worker)
        self._idle.append(worker)  # only now: the next taker counts it as busy again
        if error is not None:
            raise error
        return result

    def _take_worker(self) -> _Worker:
        """Return an idle worker, or a new one."""
        with self._lock:  # also since start_process changes what all threads see
            if self._cancelled:
                raise WorkerDiedError("the pool was shut down")
            worker = self._idle.pop() if self._idle else self._start()
            self._busy.add(worker)
        return worker

    def _start(self) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        try:
            process = start_process(_work, theirs)
        except (OSError, EOFError):  # a fork server that was killed may be seen to live on
            end_fork_server()
            process = start_process(_work, theirs)
        theirs.close()
        return _Worker(process, ours)


def _work(connection: Connection) -> None:
    """Do tasks until the pool closes the connection, or its program has died."""
    # A Ctrl-C goes to all processes of a terminal; the pool's program alone reacts.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})
    # The libraries are never garbage, and a run leaves little: to scan both takes a twentieth.
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    while True:
        try:
            work = connection.recv_bytes()
        except (EOFError, OSError):
            return
        with contextlib.suppress(OSError):
            connection.send_bytes(_result(work))


def _result(work: bytes) -> bytes:
    try:
        fn, args, kwargs = pickle.loads(work)
        return pickle.dumps((fn(*args, **kwargs), None))
    except Exception as error:
        return pickle.dumps((None, _sendable(error)))


def _sendable(error: Exception) -> Exception:
    """Return the error, or one with its text: a user's class may not survive pickling."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def _ending(code: int | None) -> str:
    if code is not None and code < 0:
        with contextlib.suppress(ValueError):
            return f"killed by {signal.Signals(-code).name}"
    return f"exit status {code}"
