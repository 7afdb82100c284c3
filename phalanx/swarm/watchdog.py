"""An end to methods of a user's that do not return: an endless loop is said to be one."""

import ctypes
import logging
import sys
import threading
from typing import Self

from phalanx.theory.expressions.asked import EndlessLoopError, questions

log = logging.getLogger("phalanx.swarm")

_SHARE = 0.5
"""Of the plant's patience with an agent: so it hears why before it gives the agent up."""
_LOOKS = 20
"""A question that was there so often in a row is not answered."""


class Watchdog:
    """Raises EndlessLoopError in any thread that has waited too long for a user's method.

    It looks from a thread of its own, so that nobody else reads a clock; a process that stood still
    is looked at no more often for that.
    """

    def __init__(self, timeout: float) -> None:
        """timeout: of the plant's wait for an agent [s]."""
        self._pause = _SHARE * timeout / _LOOKS
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _watch(self) -> None:
        seen: dict[int, tuple[object, int]] = {}
        while not self._over.wait(self._pause):
            before, seen = seen, {}
            for thread, question in questions.copy().items():
                last, looks = before.get(thread, (None, 0))
                looks = looks + 1 if question is last else 0
                seen[thread] = question, looks
                if looks and looks % _LOOKS == 0:
                    _end(thread, again=looks > _LOOKS)


def _end(thread: int, again: bool) -> None:
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
