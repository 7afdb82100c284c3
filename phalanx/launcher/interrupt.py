"""Ctrl-C, remembered until somebody answers it.

Python raises KeyboardInterrupt in whatever runs just then. Where that is a callback, as at the end
of an import's lock, the exception is printed and dropped, and the program goes on.
"""

import signal

_unanswered = False


def remember() -> None:
    """From now on remember every Ctrl-C; to be called in the main thread."""
    signal.signal(signal.SIGINT, _on_interrupt)


def raise_unanswered() -> None:
    """Raise KeyboardInterrupt if there was a Ctrl-C that nobody has answered."""
    if _unanswered:
        raise KeyboardInterrupt


def answer() -> None:
    """Whoever calls this does what there is to do about it."""
    global _unanswered
    _unanswered = False


def _on_interrupt(*_: object) -> None:
    global _unanswered
    _unanswered = True
    raise KeyboardInterrupt
