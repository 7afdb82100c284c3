"""The broadcasts of one sender on their way to one receiver."""

from typing import NamedTuple, Protocol


class SentInput(Protocol):
    """A broadcast as the inbox needs it."""

    @property
    def k(self) -> int:
        """Its sequence number."""

    @property
    def t_apply(self) -> float:
        """When the input takes effect, and the broadcast leaves [s]."""

    @property
    def u(self) -> tuple[float, ...]:
        """The input, shape (m_l,)."""


class Arrived(NamedTuple):
    """A broadcast that is here, its fate not decided."""

    message: SentInput
    at: float | None
    """When it came [s of virtual time], in real time."""


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
        self._arrived[k] = Arrived(message, at)
        return True

    def lacks(self, since: int, latest: int) -> bool:
        """Whether one that is to be decided has yet to arrive."""
        first = max(self.decided + 1, since)
        return any(k not in self._arrived for k in range(first, latest + 1))

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
        """Those up to the latest, to be decided now, in order."""
        arrived = self._arrived
        taken = [arrived.pop(k) for k in sorted(arrived) if k <= latest] if arrived else []
        self.decided = max(self.decided, latest)
        return taken

    def fly(self, arrival: float, message: SentInput) -> None:
        """A copy of a broadcast arrives at a time [s]."""
        self._in_flight.append((arrival, message))

    def land(self, t: float) -> SentInput | None:
        """Of those that have arrived by t [s] the newest, if it is newer than all before.

        A slow broadcast may arrive after one that was sent later: the newest counts.
        """
        due = [message for arrival, message in self._in_flight if arrival <= t]
        if not due:
            return None
        self._in_flight = [flying for flying in self._in_flight if flying[0] > t]
        newest = max(due, key=lambda message: message.k) if len(due) > 1 else due[0]
        if newest.k <= self._newest:
            return None
        self._newest = newest.k
        return newest
