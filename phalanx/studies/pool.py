"""A pool of worker processes: an Executor in which a worker's death costs one task, not all.

concurrent.futures fails every pending task when one of its workers dies. Here only the task that
it had fails, and the worker is replaced.
"""

import contextlib
import gc
import multiprocessing
import os
import pickle
import signal
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from multiprocessing.connection import Connection, wait
from typing import Any, NamedTuple, ParamSpec, TypeVar

from phalanx.compat.forkserver import without_main
from phalanx.launcher.libraries import start_loading

P = ParamSpec("P")
T = TypeVar("T")


class WorkerDiedError(RuntimeError):
    """A task's worker ended before the task; the message says how."""


class _Task(NamedTuple):
    future: "Future[Any]"
    work: bytes
    """The pickled function and its arguments."""


class _Worker(NamedTuple):
    process: Any
    connection: Connection


class Pool(Executor):
    """Processes forked from one that has loaded the libraries; each has one task at a time."""

    def __init__(self, workers: int | None = None) -> None:
        """Begin with no worker; they start with the first tasks.

        workers: their number; by default that of the processors.
        """
        self.workers = workers or len(os.sched_getaffinity(0))
        self._context: Any = start_loading()
        self._tasks: deque[_Task] = deque()
        self._busy: dict[Connection, tuple[_Worker, _Task]] = {}
        self._idle: list[_Worker] = []
        self._lock, self._over = threading.Lock(), False
        self._woken, self._wake = multiprocessing.Pipe(duplex=False)
        self._thread = threading.Thread(target=self._serve, name="study-pool", daemon=True)
        self._thread.start()

    def submit(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> "Future[T]":
        """Have a worker call a function; its exception, or WorkerDiedError, is the future's."""
        future: Future[T] = Future()
        task = _Task(future, pickle.dumps((fn, args, kwargs)))
        with self._lock:
            if self._over:
                raise RuntimeError("the pool was shut down")
            self._tasks.append(task)
        self._wake.send_bytes(b"")
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Let the tasks end, unless they are to be cancelled: then end the workers at once."""
        with self._lock:
            self._over = True
            if cancel_futures:
                for task in self._tasks:
                    task.future.cancel()
                self._tasks.clear()
                for worker, _ in self._busy.values():
                    worker.process.kill()
        with contextlib.suppress(OSError):
            self._wake.send_bytes(b"")
        if wait:
            self._thread.join()

    def _serve(self) -> None:
        """Hand out tasks and take results until the pool is shut down and nothing is left."""
        while True:
            with self._lock:
                self._hand_out()
                if self._over and not (self._tasks or self._busy):
                    break
                waiting = [self._woken, *self._busy]
            for ready in wait(waiting):
                assert isinstance(ready, Connection)
                if ready is self._woken:
                    self._woken.recv_bytes()
                else:
                    self._take_result(ready)
        for worker in self._idle:
            worker.connection.close()  # it ends by itself
        for worker in self._idle:
            worker.process.join()

    def _hand_out(self) -> None:
        while self._tasks and len(self._busy) < self.workers:
            task = self._tasks.popleft()
            if not task.future.set_running_or_notify_cancel():
                continue
            worker = self._idle.pop() if self._idle else self._start()
            with contextlib.suppress(OSError):  # it has died: seen when its result is taken
                worker.connection.send_bytes(task.work)
            self._busy[worker.connection] = worker, task

    def _take_result(self, connection: Connection) -> None:
        try:
            result, error = pickle.loads(connection.recv_bytes())
        except (EOFError, OSError):
            self._died(connection)
            return
        with self._lock:
            worker, task = self._busy.pop(connection)
            self._idle.append(worker)
        if error is None:
            task.future.set_result(result)
        else:
            task.future.set_exception(error)

    def _died(self, connection: Connection) -> None:
        with self._lock:
            worker, task = self._busy.pop(connection)
        connection.close()
        worker.process.join()
        task.future.set_exception(WorkerDiedError(_ending(worker.process.exitcode)))

    def _start(self) -> _Worker:
        ours, theirs = multiprocessing.Pipe()
        process = self._context.Process(target=_work, args=(theirs,), name="phalanx-study")
        with without_main():
            process.start()
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
