"""An agent's inbox for broadcasts: all that were sent arrive; the link rule says what it got."""

import math
from collections.abc import Callable, Iterable, Mapping, Set
from typing import NamedTuple, Protocol

import msgspec

from phalanx.network.link import Link
from phalanx.theory.rows.information import ReceivedInput


class Claim(msgspec.Struct, array_like=True, frozen=True):
    """A broadcast's statement of its sender's input, true or not."""

    t_apply: float
    """Since when it is in force [s]."""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""


class SentInput(ReceivedInput, Protocol):
    """A broadcast as the inbox needs it; it leaves when its input takes effect."""

    @property
    def k(self) -> int:
        """Its sequence number."""


class Existing(NamedTuple):
    """Which broadcasts of one sender exist for a receiver, as its sample counts them."""

    since: int
    """The first that counts."""
    latest: int
    """The last."""


class Fate(msgspec.Struct, array_like=True, frozen=True):
    """The fate of one broadcast on its way to the agent that reports it."""

    sender: int
    k: int
    delay: float
    """Of the first copy that can be read [s]; negative if there is none: lost."""
    faults: tuple[int, ...] = ()
    """Which of the faults that the scenario declares had a part in it, by number."""
    claim: Claim | None = None
    """Its statement; None if it was lost."""


class BroadcastInbox:
    """Broadcasts of the other agents, in the order of their sequence numbers.

    Real messages come as the transport brings them, after or before the sample that counts them.
    What the agent may know at t is decided here, by the link rule alone, so that delay and loss
    are exact and the machine's load has no part in them.

    A sender whose broadcasts a sample does not count is out of sight: nothing is known of its input
    any more, until broadcasts count that were sent since it came back.
    """

    def __init__(self, senders: Iterable[int], link: Callable[[int], Link]) -> None:
        """Listen to some senders, and to nobody else.

        Args:
            senders: their indices.
            link: from a sender; made when its first broadcast is decided, since of a large swarm
                most stay out of sight.
        """
        self._incoming = {sender: Incoming() for sender in senders}
        self._make, self._links = link, dict[int, Link]()
        self._override: tuple[float | None, float | None] = None, None
        self._in_sight: Set[int] = frozenset()
        self._received: dict[int, SentInput] = {}
        self._corrupt: list[tuple[int, SentInput]] = []

    def override_links(self, loss: float | None, delay: float | None) -> None:
        """Replace loss and delay [s] of every link's model, where given."""
        self._override = loss, delay
        for link in self._links.values():
            link.override(loss, delay)

    @property
    def senders(self) -> list[int]:
        """The senders that this inbox listens to."""
        return list(self._incoming)

    def join_at(self, existing: Mapping[int, Existing]) -> None:
        """Begin in the middle of a run: what exists by now will not come any more."""
        for sender, (since, latest) in existing.items():
            incoming = self._incoming[sender]
            incoming.since = since
            incoming.skip_to(latest)
        self._in_sight = existing.keys()

    def put(self, sender: int, message: SentInput, at: float = -math.inf) -> bool:
        """Keep a broadcast. False if it is from the past or already here: a replay.

        at: when it came [s of virtual time]; in lockstep before all that counts.
        """
        return self._incoming[sender].put(message, at)

    def missing(self, existing: Mapping[int, Existing]) -> bool:
        """Whether a broadcast that exists by now, by sender, has yet to arrive."""
        return any(self._incoming[sender].lacks(*counted) for sender, counted in existing.items())

    def lacking(self, existing: Mapping[int, Existing]) -> dict[int, list[int]]:
        """The numbers of these, by sender."""
        found = {sender: self._incoming[sender].lacking(*n) for sender, n in existing.items()}
        return {sender: numbers for sender, numbers in found.items() if numbers}

    def here(self, existing: Mapping[int, Existing]) -> dict[int, Existing]:
        """Of the broadcasts that exist by now, by sender, those up to the newest that is here.

        What is not here by then, in real time, is lost.
        """
        return {
            sender: Existing(since, self._incoming[sender].newest_here())
            for sender, (since, _) in existing.items()
        }

    def advance(
        self,
        existing: Mapping[int, Existing],
        t: float,
        distance: Callable[[int], float] = lambda _: math.nan,
    ) -> tuple[Fate, ...]:
        """Decide every broadcast that exists by now, by sender, and deliver those due by t [s].

        Returns the fates of those decided now. Of several delivered, the newest counts.
        distance: to a sender, at the sample that first counts its broadcast [m].
        """
        for sender in self._in_sight - existing.keys():
            self._incoming[sender].forget()
            self._received.pop(sender, None)
        self._in_sight = existing.keys()
        fates: list[Fate] = []
        for sender, (since, latest) in existing.items():
            incoming = self._incoming[sender]
            if incoming.since != since:
                incoming.begin(since)
                self._received.pop(sender, None)
            if latest > incoming.decided:
                fates += self._decide(sender, latest, t, distance)
            if (newest := incoming.land(t)) is not None:
                self._received[sender] = newest
        return tuple(fates)

    def take_corrupt(self) -> list[tuple[int, SentInput]]:
        """Senders and broadcasts of which a copy with a flipped byte has come since last asked."""
        taken, self._corrupt = self._corrupt, []
        return taken

    def received(self) -> Mapping[int, SentInput]:
        """The newest broadcast by sender; one never heard since it came into sight is absent."""
        return self._received

    def _decide(
        self, sender: int, latest: int, t: float, distance: Callable[[int], float]
    ) -> list[Fate]:
        """Have the sender's link decide its broadcasts up to the latest, in order, at t [s]."""
        fates, incoming = [], self._incoming[sender]
        link = self._links.get(sender) or self._new_link(sender)
        apart = distance(sender) if link.asks_distance else math.nan
        first, incoming.decided = incoming.decided + 1, latest
        for k in range(first, latest + 1):
            if k not in incoming.arrived:  # in real time it is lost
                continue
            message, at = incoming.arrived.pop(k)
            # It is sent when the input takes effect, and delays count from then; in real time
            # they come on top of what it took to be here.
            begins = message.t_apply
            sent = max(begins, min(at, t))
            passage = link.fate(k, sent, apart)
            after = math.inf
            for copy in passage.copies:
                if copy.corrupt:
                    self._corrupt.append((sender, message))
                else:
                    after = min(after, copy.after)
                    incoming.in_flight.append((sent + copy.after, message))
            if after == math.inf:
                fates.append(Fate(sender, k, -1.0, passage.faults))
            else:
                claim = Claim(begins, message.u)
                fates.append(Fate(sender, k, sent - begins + after, passage.faults, claim))
        return fates

    def _new_link(self, sender: int) -> Link:
        link = self._links[sender] = self._make(sender)
        link.override(*self._override)
        return link


class Incoming:
    """Broadcasts of one sender: those here, those decided, and those on their way."""

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
