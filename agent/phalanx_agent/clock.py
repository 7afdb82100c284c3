"""An agent's clock: in lockstep it waits for all broadcasts, in real time for none."""

import math
import time
from collections.abc import Mapping

from phalanx.messages.kinds import Sample
from phalanx.network.inbox import BroadcastInbox, BroadcastRange
from phalanx.theory.rows.information import ReceivedInput

Received = tuple[tuple[int, float, tuple[float, ...]], ...]
"""(Agent's index, t_apply [s], u) of every û_l, as in telemetry."""


class VirtualClock:
    """Lockstep: virtual time waits for all answers, and no broadcast is late."""

    waits = True
    """Whether the plant waits for the answer."""

    def now(self) -> float:
        """Return the arrival time of a broadcast that comes now [s]: before every sample."""
        return -math.inf

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, BroadcastRange]) -> bool:
        """Return whether to wait for one of the broadcasts that exist, by sender."""
        return inbox.lacks(existing)

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, BroadcastRange]
    ) -> Mapping[int, BroadcastRange]:
        """Return the broadcasts, by sender, whose fates are decided now."""
        return existing

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """Return the received inputs for telemetry: none, because they follow from the seed."""
        return ()


class RealTimeClock:
    """Real time: the wall clock since the last sample; the plant does not wait."""

    waits = False

    def __init__(self, t: float, pace: float) -> None:
        """Start at virtual time t [s]; pace: seconds of virtual time per second of wall time."""
        self._t, self._pace, self._wall = t, pace, time.monotonic()

    def now(self) -> float:
        """Return the virtual time [s]."""
        return self._t + self._pace * (time.monotonic() - self._wall)

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, BroadcastRange]) -> bool:
        """Return False: broadcasts that have not come count as lost."""
        return False

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, BroadcastRange]
    ) -> Mapping[int, BroadcastRange]:
        """Return the ranges up to the newest broadcast that has come."""
        return inbox.up_to_newest(existing)

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """Return all received inputs, from which `phalanx verify` repeats the decision."""
        return tuple((l, known.t_apply, known.u) for l, known in received.items())


Clock = VirtualClock | RealTimeClock
LOCKSTEP = VirtualClock()


def clock_of(sample: Sample) -> Clock:
    """Return the clock for a sample."""
    return LOCKSTEP if sample.pace is None else RealTimeClock(sample.t, sample.pace)
