"""What the page asks of a feed, be it a live run or a recording."""

from collections.abc import Sequence
from typing import Protocol

from phalanx.arrays import Array
from phalanx.guarantee.verdict import Summary, Violation
from phalanx.wire.messages import Frame, LogLine
from phalanx_viewer.feeds.history import History
from phalanx_viewer.scene.model import SceneModel


class Feed(Protocol):
    """Where frames come from."""

    model: SceneModel
    history: History
    summary: Summary | None
    """The verdict, once there is one."""
    over: bool
    """Whether a live run's plant has left; never of a recording."""

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
