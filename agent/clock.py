"""An agent's clock: in lockstep all is waited for, in real time the agent takes what is there."""

import math
import time
from collections.abc import Mapping
from typing import Protocol

from phalanx.network.inbox import BroadcastInbox, Existing
from phalanx.theory.rows.information import ReceivedInput
from phalanx.wire.messages import Sample

Received = tuple[tuple[int, float, tuple[float, ...]], ...]
"""(Agent's index, t_apply [s], u) of every û_l, as telemetry has it."""


class Clock(Protocol):
    """Decides what a sample waits for."""

    waits: bool
    """Whether virtual time stands still until all samples are answered."""

    def now(self) -> float:
        """Virtual time at which a broadcast that is here now came [s]."""

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, Existing]) -> bool:
        """Whether one of the broadcasts that exist, by sender, has to be waited for."""

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, Existing]
    ) -> Mapping[int, Existing]:
        """Which of the broadcasts that exist, by sender, are decided now."""

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """The received inputs, where nobody else can tell which they were."""


class Lockstep:
    """A clock that stands still until all have answered: no broadcast is ever late."""

    waits = True

    def now(self) -> float:
        """Before all that counts: a broadcast leaves when its input takes effect."""
        return -math.inf

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, Existing]) -> bool:
        """Whether one has yet to arrive."""
        return inbox.missing(existing)

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, Existing]
    ) -> Mapping[int, Existing]:
        """All of them."""
        return existing

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """Nothing: they follow from the seed."""
        return ()


class RealTime:
    """The agent's own clock, which goes on from its last sample."""

    waits = False

    def __init__(self, t: float, pace: float) -> None:
        """It is t [s] now; pace: seconds of virtual time per second of wall time."""
        self._t, self._pace, self._wall = t, pace, time.monotonic()

    def now(self) -> float:
        """Virtual time [s]."""
        return self._t + self._pace * (time.monotonic() - self._wall)

    def lacks(self, inbox: BroadcastInbox, existing: Mapping[int, Existing]) -> bool:
        """Nobody waits."""
        return False

    def counted(
        self, inbox: BroadcastInbox, existing: Mapping[int, Existing]
    ) -> Mapping[int, Existing]:
        """Those up to the newest that is here; what is not here by then is lost."""
        return inbox.here(existing)

    def reported(self, received: Mapping[int, ReceivedInput]) -> Received:
        """All: a recording can decide the step again from them alone."""
        return tuple((l, known.t_apply, known.u) for l, known in received.items())


LOCKSTEP = Lockstep()


def clock_of(sample: Sample) -> Clock:
    """The clock by which a sample was taken."""
    return LOCKSTEP if sample.pace is None else RealTime(sample.t, sample.pace)
