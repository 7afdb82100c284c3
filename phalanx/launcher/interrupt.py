"""Ctrl-C and SIGTERM, remembered until somebody answers them.

Python raises KeyboardInterrupt in whatever runs just then. Where that is a callback, as at the end
of an import's lock, the exception is printed and dropped, and the program goes on.
"""

import contextlib
import signal
from collections.abc import Iterator

_unanswered = False
_held_back = False
_terminated = False


def remember() -> None:
    """From now on take a SIGTERM as a Ctrl-C, and remember both; call it in the main thread."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # Of a program that a shell started in the background: a Ctrl-C is meant for others.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _on_interrupt)


def terminated() -> bool:
    """Whether there was a SIGTERM: nobody is there to send a second one."""
    return _terminated


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


@contextlib.contextmanager
def let_in() -> Iterator[None]:
    """Within held_back: meanwhile a Ctrl-C does break in, also one that came before."""
    global _held_back
    before, _held_back = _held_back, False
    try:
        raise_unanswered()
        yield
    finally:
        _held_back = before


def _on_interrupt(number: int, _: object) -> None:
    global _unanswered, _terminated
    _unanswered, _terminated = True, _terminated or number == signal.SIGTERM
    if not _held_back:
        raise KeyboardInterrupt
