"""Ctrl-C, remembered until somebody answers it.

Python raises KeyboardInterrupt in whatever runs just then. Where that is a callback, as at the end
of an import's lock, the exception is printed and dropped, and the program goes on.
"""

import contextlib
import signal
from collections.abc import Iterator

_unanswered = False
_held_back = False


def remember() -> None:
    """From now on remember every Ctrl-C; to be called in the main thread."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        return  # a shell started it in the background: a Ctrl-C is meant for others
    signal.signal(signal.SIGINT, _on_interrupt)


def raise_unanswered() -> None:
    """Raise KeyboardInterrupt if there was a Ctrl-C that nobody has answered."""
    if _unanswered:
        raise KeyboardInterrupt


def answer() -> None:
    """Whoever calls this does what there is to do about it."""
    global _unanswered
    _unanswered = False


@contextlib.contextmanager
def held_back() -> Iterator[None]:
    """Meanwhile a Ctrl-C breaks into nothing: raise_unanswered alone raises it."""
    global _held_back
    _held_back = True
    try:
        yield
    finally:
        _held_back = False


def _on_interrupt(*_: object) -> None:
    global _unanswered
    _unanswered = True
    if not _held_back:
        raise KeyboardInterrupt
