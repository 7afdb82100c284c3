"""Virtual time between an agent's samples, in real time: by its own clock, since the last one."""

import time


class VirtualClock:
    """What an agent knows of virtual time: the last sample's, and how fast it goes since."""

    def __init__(self) -> None:
        self._pace: float | None = None
        self._t = self._wall = 0.0

    def set(self, t: float, pace: float | None) -> None:
        """It is t [s] now; pace: seconds per second of wall time, None where nobody can say."""
        self._t, self._pace, self._wall = t, pace, time.monotonic()

    def now(self) -> float | None:
        """[s]; None in lockstep, whose time stands still until all have answered."""
        if self._pace is None:
            return None
        return self._t + self._pace * (time.monotonic() - self._wall)
