"""A watchdog for what waits too long, such as for a user's method that does not return."""

import ctypes
import logging
import sys
import threading
from collections.abc import Callable, Mapping
from typing import Generic, Self, TypeVar

from phalanx.theory.expressions.asked import EndlessLoopError, questions

log = logging.getLogger("phalanx.swarm")
K = TypeVar("K")
T = TypeVar("T")

_SHARE = 0.5
"""Of the plant's patience with an agent: so it hears why before it gives the agent up."""
_LOOKS = 20
"""Something that waits so many looks in a row is stalled."""


class Watchdog(Generic[K, T]):
    """Calls a function for whatever waits too long, from a thread of its own, while a block runs.

    It counts looks, not seconds: a process that stood still is looked at no more often for that.
    """

    def __init__(
        self,
        patience: float,
        waiting: Callable[[], Mapping[K, T]],
        stalled: Callable[[K, T, bool], None],
    ) -> None:
        """Watch nothing yet.

        Args:
            patience: how long something may wait [s].
            waiting: what waits now, and for what.
            stalled: called each time that something has waited so long; its last argument says
                whether it was called before.
        """
        self._pause, self._waiting, self._stalled = patience / _LOOKS, waiting, stalled
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        seen: dict[K, tuple[T | None, int]] = {}
        while not self._over.wait(self._pause):
            before, seen = seen, {}
            for key, item in self._waiting().items():
                last, looks = before.get(key, (None, 0))
                looks = looks + 1 if item is last else 0
                seen[key] = item, looks
                if looks and looks % _LOOKS == 0:
                    self._stalled(key, item, looks > _LOOKS)


def endless_loops(timeout: float) -> Watchdog[int, object]:
    """Raises EndlessLoopError in any thread that waits too long for a user's method.

    timeout: of the plant's wait for an agent [s].
    """
    return Watchdog(_SHARE * timeout, questions.copy, _end)


def _end(thread: int, _: object, again: bool) -> None:
    """Raise in a thread, unless somebody debugs it; say where it stands if it was raised before."""
    frame = standing = sys._current_frames().get(thread)
    while frame is not None:
        if frame.f_globals.get("__name__") == "bdb":
            return
        frame = frame.f_back
    if again and standing is not None:
        where = f"{standing.f_code.co_filename}, line {standing.f_lineno}"
        log.error("no answer, and no end to it: %s in %s", standing.f_code.co_name, where)
    raised = ctypes.py_object(EndlessLoopError)
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread), raised)
