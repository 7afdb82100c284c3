"""Work in forked processes: each inherits all that this one has built, and sends back a result.

A process that has opened a Zenoh session must not fork.
"""

import gc
import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.connection import Connection
from multiprocessing.context import ForkProcess
from typing import Generic, NamedTuple, TypeVar

from phalanx.launcher.engine import EngineError

T = TypeVar("T")


def in_forks(works: Iterable[Callable[[], T]], at_once: int) -> Iterator[T]:
    """Do each work in a process forked from this one, and yield the results in order.

    at_once: most processes that run at the same time. Those left are killed if the caller stops.

    Raises EngineError: a process died. Raises the error of a work.
    """
    running: deque[_Fork[T]] = deque()
    gc.collect()
    gc.freeze()  # pages that no collection writes to stay shared
    try:
        for work in works:
            if len(running) >= at_once:
                yield running.popleft().result()
            running.append(_start(work))
        while running:
            yield running.popleft().result()
    finally:
        gc.unfreeze()
        for fork in running:
            fork.process.kill()
            fork.process.join()


class _Fork(NamedTuple, Generic[T]):
    process: ForkProcess
    pipe: Connection

    def result(self) -> T:
        """Wait for its result and its end. Raises as in_forks."""
        try:
            found = self.pipe.recv()
        except EOFError:
            found = EngineError("a process died before it had a result; is there enough memory?")
        self.pipe.close()
        self.process.join()
        if isinstance(found, Exception):
            raise found
        result: T = found
        return result


def _start(work: Callable[[], T]) -> _Fork[T]:
    context = multiprocessing.get_context("fork")
    receives, sends = context.Pipe(duplex=False)
    process = context.Process(target=_run, args=(work, sends), daemon=True)
    process.start()
    sends.close()
    return _Fork(process, receives)


def _run(work: Callable[[], object], pipe: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that forked reacts to a Ctrl-C
    try:
        pipe.send(work())
    except Exception as error:
        pipe.send(error)
