"""Being told to stop following a feed."""

import signal
from collections.abc import Callable


def stop_request() -> Callable[[], bool]:
    """Whether SIGINT or SIGTERM came since this call."""
    # No event: a handler that sets one while this thread is about to wait for it never returns.
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: came.append(number))
    return lambda: bool(came)
