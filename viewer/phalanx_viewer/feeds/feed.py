"""A source of frames, be it a live run or a recording, and when to stop following it."""

import signal
from collections.abc import Callable, Sequence
from typing import Protocol

from phalanx.arrays import Array
from phalanx.curves.history import History
from phalanx.guarantee.verdict import Summary, Violation
from phalanx.wire.messages import Frame, LogLine
from phalanx_viewer.scene.model import SceneModel

SPACING = 0.2
"""Between two points of a recent path [s]."""
_MOST_POINTS, _MOST_OF_ALL_AGENTS = 60, 3000


class Feed(Protocol):
    """Where frames come from."""

    model: SceneModel
    summary: Summary | None
    """The verdict, once there is one."""
    over: bool
    """Whether a live run's plant has left; never of a recording."""

    @property
    def history(self) -> History:
        """The run's past."""

    @property
    def unfinished(self) -> str:
        """Why there will be no verdict, in words; empty otherwise."""

    @property
    def log(self) -> Sequence[LogLine]:
        """Every line of the event log, as far as it is known."""

    def take(self) -> Frame | None:
        """The newest frame, unless it was taken before."""

    @property
    def violations(self) -> Sequence[Violation]:
        """Every pair that was unsafe, as far as it is known."""

    def recent_paths(self, t: float) -> Array:
        """Positions on the way to t [s], shape (s, N, 3)."""


def path_points(agents: int) -> int:
    """How many points each recent path may have: all of them are sent anew, as one message."""
    return max(4, min(_MOST_POINTS, _MOST_OF_ALL_AGENTS // agents))


def stop_request() -> Callable[[], bool]:
    """Whether SIGINT or SIGTERM came since this call."""
    # No event: a handler that sets one while this thread is about to wait for it never returns.
    came: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: came.append(number))
    return lambda: bool(came)
