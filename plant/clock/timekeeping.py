"""What a run in real time measures of itself: gaps between samples, and how long answers take."""

from array import array

from phalanx.guarantee.punctuality import Punctuality, percentiles


class Timekeeping:
    """Counts and times of one run, in seconds of virtual time unless said otherwise."""

    def __init__(self, periods: list[float]) -> None:
        """periods: Γ_i of each agent [s]."""
        self.missed = self.unanswered = self.late = 0
        self._periods = periods
        self._sampled: dict[int, float] = {}
        self._behind, self._jitter, self._latency = array("d"), array("d"), array("d")

    def sampled(self, i: int, t: float, tick: float) -> None:
        """Agent i took a sample at t, for a tick of its clock."""
        self._behind.append(t - tick)
        if i in self._sampled:
            self._jitter.append(abs(t - self._sampled[i] - self._periods[i]))
        self._sampled[i] = t

    def missed_tick(self, i: int) -> None:
        """Agent i took no sample at a tick of its clock; the next gap is no jitter."""
        self.missed += 1
        self._sampled.pop(i, None)

    def answered(self, wall: float) -> None:
        """An answer took so long, from the plant and back [s of wall time]."""
        self._latency.append(wall)

    @property
    def summary(self) -> Punctuality:
        """All of it."""
        return Punctuality(
            samples=len(self._behind),
            missed=self.missed,
            unanswered=self.unanswered,
            late=self.late,
            measured=[
                percentiles("sample behind its clock", self._behind),
                percentiles("sampling gap off its period", self._jitter),
                percentiles("sample to input, wall time", self._latency),
            ],
        )
