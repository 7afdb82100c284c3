"""An agent's clock: in lockstep all is waited for, in real time the agent takes what is there."""

import math
import time
from collections.abc import Mapping

from phalanx.network.inbox import BroadcastInbox, Existing
from phalanx.theory.rows.information import ReceivedInput
from phalanx.wire.messages import Sample

Received = tuple[tuple[int, float, tuple[float, ...]], ...]
"""(Agent's index, t_apply [s], u) of every û_l, as telemetry has it."""


class VirtualClock:
    """Lockstep: time stands still until all have answered, and no broadcast is ever late."""

    waits = True
    """Whether the plant waits for the answer."""

    def now(self) -> float:
        """Virtual time at which a broadcast that is here now came [s]: before all that counts."""
        return -math.inf

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, Existing]) -> bool:
        """Whether one of the broadcasts that exist, by sender, has to be waited for."""
        return inbox.missing(existing)

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, Existing]
    ) -> Mapping[int, Existing]:
        """Which of the broadcasts that exist, by sender, are decided now."""
        return existing

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """The received inputs, unless they follow from the seed."""
        return ()


class RealTimeClock(VirtualClock):
    """The agent's own clock, which goes on from its last sample; the plant does not wait."""

    waits = False

    def __init__(self, t: float, pace: float) -> None:
        """It is t [s] now; pace: seconds of virtual time per second of wall time."""
        self._t, self._pace, self._wall = t, pace, time.monotonic()

    def now(self) -> float:
        """Virtual time [s]."""
        return self._t + self._pace * (time.monotonic() - self._wall)

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, Existing]) -> bool:
        """Never."""
        return False

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, Existing]
    ) -> Mapping[int, Existing]:
        """Those up to the newest that is here; what is not here by then is lost."""
        return inbox.here(existing)

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """All: from them alone a recording can decide the step again."""
        return tuple((l, known.t_apply, known.u) for l, known in received.items())


LOCKSTEP = VirtualClock()


def clock_of(sample: Sample) -> VirtualClock:
    """The clock by which a sample was taken."""
    return LOCKSTEP if sample.pace is None else RealTimeClock(sample.t, sample.pace)
