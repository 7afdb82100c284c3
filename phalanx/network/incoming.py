"""The broadcasts of one sender on their way to one receiver."""

from typing import Protocol

from phalanx.theory.rows.information import ReceivedInput


class SentInput(ReceivedInput, Protocol):
    """A broadcast as the inbox needs it; it leaves when its input takes effect."""

    @property
    def k(self) -> int:
        """Its sequence number."""


Arrived = tuple[SentInput, float | None]
"""A broadcast that is here, its fate not decided, and in real time when it came [s]."""


class Incoming:
    """What is here of a sender, what is decided, and what is on its way."""

    __slots__ = ("_arrived", "_in_flight", "_newest", "decided", "since")

    def __init__(self) -> None:
        self.since: int | None = None
        """The first broadcast that counts; None while the sender is out of sight."""
        self.decided = -1
        """The last one whose fate is decided."""
        self._arrived: dict[int, Arrived] = {}
        self._in_flight: list[tuple[float, SentInput]] = []
        self._newest = -1

    def put(self, message: SentInput, at: float | None) -> bool:
        """Keep a broadcast. False if it is from the past or already here."""
        k = message.k
        if k <= self.decided or k in self._arrived:
            return False
        self._arrived[k] = message, at
        return True

    def lacks(self, since: int, latest: int) -> bool:
        """Whether one that is to be decided has yet to arrive."""
        first = max(self.decided + 1, since)
        return not self._arrived.keys() >= set(range(first, latest + 1))

    def newest_here(self) -> int:
        """The last one that is here or decided."""
        return max(self._arrived, default=self.decided)

    def begin(self, since: int) -> None:
        """From now on those from `since` on count, and no others."""
        self.forget()
        self.since = since
        self.skip_to(since - 1)

    def skip_to(self, k: int) -> None:
        """Broadcasts up to k are of the past."""
        self.decided = k
        self._arrived = {n: message for n, message in self._arrived.items() if n > k}

    def forget(self) -> None:
        """Nothing that was sent so far counts any more."""
        self.since = None
        self._in_flight = []

    def take(self, latest: int) -> list[Arrived]:
        """Those not decided up to the latest, to be decided now, in order."""
        arrived, first = self._arrived, self.decided + 1
        self.decided = latest
        return [arrived.pop(k) for k in range(first, latest + 1) if k in arrived]

    def fly(self, arrival: float, message: SentInput) -> None:
        """A copy of a broadcast arrives at a time [s]."""
        self._in_flight.append((arrival, message))

    def land(self, t: float) -> SentInput | None:
        """Of those that have arrived by t [s] the newest, if it is newer than all before.

        A slow broadcast may arrive after one that was sent later: the newest counts.
        """
        newest, in_flight = None, []
        for flying in self._in_flight:
            arrival, message = flying
            if arrival > t:
                in_flight.append(flying)
            elif message.k > self._newest:
                newest, self._newest = message, message.k
        self._in_flight = in_flight
        return newest
