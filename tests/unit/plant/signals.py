"""Signals that arrive during a wait."""

import contextlib
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def outlasting_a_wait(at_last: Callable[[], None]) -> Iterator[None]:
    """Send a signal after 10 ms, whose handler takes 50 ms.

    at_last: called after 10 s, to end a wait that has no end.
    """

    def take_longer(*_: object) -> None:
        began = time.monotonic()
        while time.monotonic() < began + 0.05:
            pass

    rescue = threading.Timer(10.0, at_last)
    rescue.daemon = True
    rescue.start()
    before = signal.signal(signal.SIGUSR1, take_longer)
    threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGUSR1)).start()
    try:
        yield
    finally:
        signal.signal(signal.SIGUSR1, before)
        rescue.cancel()
