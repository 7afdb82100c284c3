"""How fast virtual time may go by the wall clock, and where it has to stop."""

import math
import time


class Pace:
    """Virtual against wall time, since the last change of the speed."""

    def __init__(self, speed: float) -> None:
        """speed: seconds of virtual time per second, at most; 0: as fast as it goes."""
        self.speed = speed
        self._until = math.inf
        """Virtual time stands still beyond it [s]."""
        self._origin = (0.0, time.monotonic())
        """Virtual and wall time from which the speed counts."""

    @property
    def paused(self) -> bool:
        """Whether virtual time stands still, or is about to."""
        return self._until < math.inf

    def now(self) -> float:
        """Where virtual time is, if nothing else holds it up [s]."""
        virtual, wall = self._origin
        elapsed = time.monotonic() - wall
        return min(self._until, virtual + self.speed * elapsed) if self.speed else self._until

    def wait(self, t: float) -> float:
        """How long it is until t [s of wall time]; infinite if virtual time stops before it."""
        if t > self._until:
            return math.inf
        if not self.speed:
            return 0.0
        virtual, wall = self._origin
        return wall + (t - virtual) / self.speed - time.monotonic()

    def restart(self, t: float) -> None:
        """It is t [s] now."""
        self._origin = (t, time.monotonic())

    def stop_at(self, until: float, now: float) -> None:
        """Go no further than `until` [s]; infinite: go on. It is `now` [s]."""
        self._until = until
        self.restart(now)

    def change(self, speed: float, now: float) -> None:
        """Go at another speed from `now` [s] on."""
        self.speed = speed
        self.restart(now)
