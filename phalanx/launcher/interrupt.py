"""Ctrl-C and SIGTERM, remembered until the program has reacted to them.

Python raises KeyboardInterrupt in the code that happens to run. If that is a callback, as at the
end of an import's lock, the exception is printed and dropped, and the program goes on.
"""

import contextlib
import signal
import threading
from collections.abc import Iterator

_pending = False
_deferred = False
_sigterm = False


def install() -> None:
    """Handle SIGTERM as Ctrl-C, and remember both; call it in the main thread."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # A shell that starts a program in the background has it ignore SIGINT: leave that.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _on_interrupt)


def sigterm_received() -> bool:
    """Return whether a SIGTERM came: then no user is there to press Ctrl-C."""
    return _sigterm


def raise_pending() -> None:
    """Raise KeyboardInterrupt if a Ctrl-C came since the last call of clear."""
    if _pending:
        raise KeyboardInterrupt


def clear() -> None:
    """Forget the Ctrl-C that came: the caller reacts to it."""
    global _pending
    _pending = False


@contextlib.contextmanager
def handled() -> Iterator[None]:
    """Remember a Ctrl-C of the block, in a program that did not call install.

    One without a reaction raises at the block's end. Elsewhere than in the main thread, and
    with a handler of the program's own, it does nothing.
    """
    usual = signal.default_int_handler
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not usual:
        yield
        return
    signal.signal(signal.SIGINT, _on_interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        came = _pending
        clear()
    if came:
        raise KeyboardInterrupt


@contextlib.contextmanager
def deferred() -> Iterator[None]:
    """Let no Ctrl-C raise during the block, except in raise_pending."""
    global _deferred
    before, _deferred = _deferred, True
    try:
        yield
    finally:
        _deferred = before


@contextlib.contextmanager
def interruptible() -> Iterator[None]:
    """Within deferred: let a Ctrl-C raise during the block, and one that came before at once."""
    global _deferred
    before, _deferred = _deferred, False
    try:
        raise_pending()
        yield
    finally:
        _deferred = before


def _on_interrupt(number: int, _: object) -> None:
    global _pending, _sigterm
    _pending, _sigterm = True, _sigterm or number == signal.SIGTERM
    if not _deferred:
        raise KeyboardInterrupt
