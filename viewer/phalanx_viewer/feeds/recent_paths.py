"""Where agents were in the last seconds: positions a fixed time apart, the oldest forgotten."""

from collections import deque

import numpy as np

from phalanx.arrays import Array

SPACING = 0.2
"""Between two points of a path [s]."""
_MOST_POINTS = 60
_MOST_OF_ALL_AGENTS = 3000


class RecentPaths:
    """The last positions of all agents, as a live run goes on."""

    def __init__(self, agents: int) -> None:
        self._past: deque[Array] = deque(maxlen=path_points(agents))
        self._due = -np.inf

    def add(self, t: float, positions: Array) -> None:
        """Positions at t [s], shape (N, 3); kept if enough time has passed."""
        if t >= self._due:
            self._due = t + SPACING
            self._past.append(positions)

    @property
    def positions(self) -> Array:
        """Shape (s, N, 3), the oldest first."""
        return np.array(self._past)


def path_points(agents: int) -> int:
    """How many points each path may have: all of them are sent anew, as one message."""
    return max(4, min(_MOST_POINTS, _MOST_OF_ALL_AGENTS // agents))
