"""The broadcasts of one sender on their way to one receiver."""

from typing import Protocol

from phalanx.theory.rows.information import ReceivedInput


class SentInput(ReceivedInput, Protocol):
    """A broadcast as the inbox needs it; it leaves when its input takes effect."""

    @property
    def k(self) -> int:
        """Its sequence number."""


class Incoming:
    """What is here of a sender, what is decided, and what is on its way."""

    __slots__ = ("_newest", "arrived", "decided", "in_flight", "since")

    def __init__(self) -> None:
        self.since: int | None = None
        """The first broadcast that counts; None while the sender is out of sight."""
        self.decided = -1
        """The last one whose fate is decided."""
        self.arrived: dict[int, tuple[SentInput, float]] = {}
        """By number those that are here and not decided, and when each came [s]."""
        self.in_flight: list[tuple[float, SentInput]] = []
        """Copies not landed, each with when it arrives [s]."""
        self._newest = -1

    def put(self, message: SentInput, at: float) -> bool:
        """Keep a broadcast. False if it is from the past or already here."""
        k = message.k
        if k <= self.decided or k in self.arrived:
            return False
        self.arrived[k] = message, at
        return True

    def lacks(self, since: int, latest: int) -> bool:
        """Whether one that is to be decided has yet to arrive."""
        first = max(self.decided + 1, since)
        return not all(map(self.arrived.__contains__, range(first, latest + 1)))

    def lacking(self, since: int, latest: int) -> list[int]:
        """The numbers of these."""
        first = max(self.decided + 1, since)
        return [k for k in range(first, latest + 1) if k not in self.arrived]

    def newest_here(self) -> int:
        """The last one that is here or decided."""
        return max(self.arrived, default=self.decided)

    def begin(self, since: int) -> None:
        """From now on those from `since` on count, and no others."""
        self.forget()
        self.since = since
        self.skip_to(since - 1)

    def skip_to(self, k: int) -> None:
        """Broadcasts up to k are of the past."""
        self.decided = k
        self.arrived = {n: message for n, message in self.arrived.items() if n > k}

    def forget(self) -> None:
        """Nothing that was sent so far counts any more."""
        self.since = None
        self.in_flight = []

    def land(self, t: float) -> SentInput | None:
        """Of those that have arrived by t [s] the newest, if it is newer than all before.

        A slow broadcast may arrive after one that was sent later: the newest counts.
        """
        newest, still = None, []
        for flying in self.in_flight:
            arrival, message = flying
            if arrival > t:
                still.append(flying)
            elif message.k > self._newest:
                newest, self._newest = message, message.k
        self.in_flight = still
        return newest
