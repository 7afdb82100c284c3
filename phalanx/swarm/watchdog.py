"""A watchdog for items that wait too long, such as calls of a user's method in a loop."""

import ctypes
import logging
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Generic, Self, TypeVar

from phalanx.theory.expressions.user_methods import EndlessLoopError, running_calls

log = logging.getLogger("phalanx.swarm")
K = TypeVar("K")
T = TypeVar("T")

_SHARE = 0.5
"""Share of the plant's timeout, so that the agent reports the reason before the plant stops it."""
_POLLS = 20
"""An item that waits for so many polls in a row is stalled."""


class Watchdog(Generic[K, T]):
    """A context manager that calls a function, in its own thread, for items that wait too long.

    It counts polls, not seconds, so that a suspended process does not look stalled.
    """

    def __init__(
        self,
        patience: float,
        waiting: Callable[[], Mapping[K, T]],
        stalled: Callable[[K, T, bool], None],
    ) -> None:
        """Prepare the thread.

        Args:
            patience: longest wait [s].
            waiting: returns the items that wait now.
            stalled: called each time that an item has waited so long; its last argument is True
                if it was called for this item before.
        """
        self._pause, self._waiting, self._stalled = patience / _POLLS, waiting, stalled
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        items: dict[K, tuple[T | None, int]] = {}
        while not self._over.wait(self._pause):
            before, items = items, {}
            for key, item in self._waiting().items():
                last, polls = before.get(key, (None, 0))
                polls = polls + 1 if item is last else 0
                items[key] = item, polls
                if polls and polls % _POLLS == 0:
                    self._stalled(key, item, polls > _POLLS)


def endless_loops(timeout: float) -> Watchdog[int, object]:
    """Raise EndlessLoopError in any thread that waits too long for a user's method.

    timeout: the plant's for an agent [s].
    """
    return Watchdog(_SHARE * timeout, running_calls.copy, _interrupt)


def _interrupt(thread: int, _: object, again: bool) -> None:
    """Raise in a thread, unless a debugger runs it; log its line if it did not end before."""
    frame = current = sys._current_frames().get(thread)
    while frame is not None:
        if frame.f_globals.get("__name__") == "bdb":
            return
        frame = frame.f_back
    if again and current is not None:
        where = f"{current.f_code.co_filename}, line {current.f_lineno}"
        log.error("still in an endless loop: %s in %s", current.f_code.co_name, where)
    raised = ctypes.py_object(EndlessLoopError)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), raised)
