"""A source of frames of one run, live or recorded, and how to follow it."""

import signal
import time
from collections.abc import Callable

from phalanx.guarantee.verdict import Outcome
from phalanx.messages.frames import Frame
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import Replay

Feed = Live | Replay

_TICK = 1.0 / 30.0
"""Wall time between two reads of a feed [s]: the plant sends frames no faster."""


def interim_outcome(frame: Frame) -> Outcome:
    """The outcome of a run if it ended with this frame."""
    if frame.violations:
        return Outcome.VIOLATED
    failed = any(assumption.failed for assumption in frame.assumptions)
    return Outcome.SAFE if failed else Outcome.GUARANTEED


def stop_request() -> Callable[[], bool]:
    """Return a function that tells if SIGINT or SIGTERM came since this call."""
    # No event: a handler that sets one while this thread is about to wait for it never returns.
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: came.append(number))
    return lambda: bool(came)


def keep_up(tick: Callable[[], None], over: Callable[[], bool]) -> None:
    """Call `tick` again and again until `over` returns true."""
    while not over():
        tick()
        time.sleep(_TICK)
