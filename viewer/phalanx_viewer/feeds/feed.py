"""A source of frames of one run, live or recorded, and when to stop following it."""

import signal
from collections.abc import Callable

from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay

Feed = Live | Replay


def stop_request() -> Callable[[], bool]:
    """Return a function that tells if SIGINT or SIGTERM came since this call."""
    # No event: a handler that sets one while this thread is about to wait for it never returns.
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: came.append(number))
    return lambda: bool(came)
