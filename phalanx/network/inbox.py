"""An agent's inbox: all broadcasts arrive; the link rules decide which of them it has received."""

import math
from collections.abc import Callable, Iterable, Mapping, Set
from typing import Protocol

import msgspec

from phalanx.network.link import Link
from phalanx.theory.rows.information import ReceivedInput


class Claim(msgspec.Struct, array_like=True, frozen=True):
    """A broadcast's statement of its sender's input, true or not."""

    t_apply: float
    """Time from which the input is in force [s]."""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""


class SentInput(ReceivedInput, Protocol):
    """A broadcast as the inbox needs it; it is sent when its input takes effect."""

    @property
    def k(self) -> int:
        """Its sequence number."""


BroadcastRange = tuple[int, int]
"""First and last number of one sender's broadcasts that a receiver's sample counts."""


class Fate(msgspec.Struct, array_like=True, frozen=True):
    """A receiver's report on one broadcast: received or lost."""

    sender: int
    k: int
    delay: float
    """Delay of the first intact copy [s]; negative if there is none: lost."""
    faults: tuple[int, ...] = ()
    """Numbers of the declared faults that had an effect on it."""
    claim: Claim | None = None
    """Its claim; None if it was lost."""


class BroadcastInbox:
    """Broadcasts of the other agents, in the order of their sequence numbers.

    The transport delivers the real messages at any time, after or before the sample that counts
    them. The link rules alone decide what the agent has received at t, so that delay and loss are
    exact and independent of the machine's load.

    A sender whose broadcasts a sample does not count is out of sight: its earlier inputs are
    discarded, and only broadcasts that it sends after its return count.
    """

    def __init__(self, senders: Iterable[int], link: Callable[[int], Link]) -> None:
        """Accept broadcasts of some senders only.

        Args:
            senders: their indices.
            link: creates the link from a sender, at its first broadcast: in a large swarm most
                senders stay out of sight.
        """
        self._incoming = {sender: Incoming() for sender in senders}
        self._make, self._links = link, dict[int, Link]()
        self._override: tuple[float | None, float | None] = None, None
        self._in_sight: Set[int] = frozenset()
        self._received: dict[int, SentInput] = {}
        self._corrupt: list[tuple[int, SentInput]] = []
        self._delivered: list[tuple[int, SentInput]] = []

    def override_links(self, loss: float | None, delay: float | None) -> None:
        """Replace loss and delay [s] of every link's model, where given."""
        self._override = loss, delay
        for link in self._links.values():
            link.override(loss, delay)

    def join_at(self, counted: Mapping[int, BroadcastRange]) -> None:
        """Begin in the middle of a run: broadcasts sent so far, by sender, will not arrive."""
        for sender, (since, latest) in counted.items():
            incoming = self._incoming[sender]
            incoming.since = since
            incoming.skip_to(latest)
        self._in_sight = counted.keys()

    def put(self, sender: int, message: SentInput, at: float = -math.inf) -> bool:
        """Store a broadcast. Return False if it was decided or stored before: a replay.

        at: virtual time of its arrival [s]; -inf in lockstep.
        """
        incoming, k = self._incoming[sender], message.k
        if k <= incoming.decided or k in incoming.arrived:
            return False
        incoming.arrived[k] = message, at
        return True

    def lacks(self, counted: Mapping[int, BroadcastRange]) -> bool:
        """Return whether a counted broadcast has yet to arrive."""
        # Called at every arrival, so it stops at the first.
        return any(self._incoming[sender].missing(*n) for sender, n in counted.items())

    def missing(self, counted: Mapping[int, BroadcastRange]) -> dict[int, list[int]]:
        """Return by sender the counted broadcasts that have yet to arrive."""
        found = {sender: self._incoming[sender].missing(*n) for sender, n in counted.items()}
        return {sender: numbers for sender, numbers in found.items() if numbers}

    def up_to_newest(self, counted: Mapping[int, BroadcastRange]) -> dict[int, BroadcastRange]:
        """Cut the ranges at the newest broadcast that has arrived, by sender.

        In real time, a broadcast that arrives after a later one is lost.
        """
        return {
            sender: (since, self._incoming[sender].newest_arrived())
            for sender, (since, _) in counted.items()
        }

    def advance(
        self,
        counted: Mapping[int, BroadcastRange],
        t: float,
        distance: Callable[[int], float] = lambda _: math.nan,
    ) -> tuple[Fate, ...]:
        """Decide every counted broadcast, by sender, and deliver those due by t [s].

        Returns reports on those decided now. If several are delivered, the newest is kept.
        distance: to a sender, at the sample that first counts its broadcast [m].
        """
        for sender in self._in_sight - counted.keys():
            self._incoming[sender].forget()
            self._received.pop(sender, None)
        self._in_sight = counted.keys()
        fates: list[Fate] = []
        for sender, (since, latest) in counted.items():
            incoming = self._incoming[sender]
            if incoming.since != since:
                incoming.begin(since)
                self._received.pop(sender, None)
            if latest > incoming.decided:
                fates += self._decide(sender, latest, t, distance)
            if not incoming.in_flight:
                continue
            landed = incoming.land(t)
            self._delivered += [(sender, message) for message in landed]
            for message in landed:
                # A slow broadcast may be delivered after one that was sent later.
                if message.k > incoming.newest:
                    incoming.newest, self._received[sender] = message.k, message
        return tuple(fates)

    def take_corrupt(self) -> list[tuple[int, SentInput]]:
        """Return the corrupt copies since the last call: their senders, and the intact messages."""
        taken, self._corrupt = self._corrupt, []
        return taken

    def take_delivered(self) -> list[tuple[int, SentInput]]:
        """Return all intact broadcasts that arrived since the last call, with their senders."""
        taken, self._delivered = self._delivered, []
        return taken

    def received(self) -> Mapping[int, SentInput]:
        """Return the newest broadcast by sender, of those received since it came into sight."""
        return self._received

    def _decide(
        self, sender: int, latest: int, t: float, distance: Callable[[int], float]
    ) -> list[Fate]:
        """Decide a sender's broadcasts up to the latest, in order, at t [s]."""
        fates, incoming = [], self._incoming[sender]
        link = self._links.get(sender) or self._new_link(sender)
        apart = distance(sender) if link.asks_distance else math.nan
        first, incoming.decided = incoming.decided + 1, latest
        for k in range(first, latest + 1):
            if k not in incoming.arrived:  # in real time it is lost
                continue
            message, at = incoming.arrived.pop(k)
            # It is sent when the input takes effect, and delays count from then; in real time
            # they are added to the real delay.
            begins = message.t_apply
            sent = begins if at <= begins else max(begins, min(at, t))
            delivery = link.fate(k, sent, apart, t)
            after = math.inf
            for copy in delivery.copies:
                if copy.corrupt:
                    self._corrupt.append((sender, message))
                else:
                    after = copy.after if copy.after < after else after
                    incoming.in_flight.append((sent + copy.after, message))
            if after == math.inf:
                fates.append(Fate(sender, k, -1.0, delivery.faults))
            else:
                claim = Claim(begins, message.u)
                fates.append(Fate(sender, k, sent - begins + after, delivery.faults, claim))
        return fates

    def _new_link(self, sender: int) -> Link:
        link = self._links[sender] = self._make(sender)
        link.override(*self._override)
        return link


class Incoming:
    """Broadcasts of one sender: those arrived, those decided, and those in flight."""

    __slots__ = ("arrived", "decided", "in_flight", "newest", "since")

    def __init__(self) -> None:
        self.since: int | None = None
        """The first broadcast that counts; None while the sender is out of sight."""
        self.decided = -1
        """The last broadcast that the link has decided."""
        self.arrived: dict[int, tuple[SentInput, float]] = {}
        """By number: broadcasts not decided yet, each with its time of arrival [s]."""
        self.in_flight: list[tuple[float, SentInput]] = []
        """Copies not delivered yet, each with its time of delivery [s]."""
        self.newest = -1
        """The newest broadcast delivered."""

    def missing(self, since: int, latest: int) -> list[int]:
        """Return the numbers in this range that are neither decided nor stored."""
        first = max(self.decided + 1, since)
        return [k for k in range(first, latest + 1) if k not in self.arrived]

    def newest_arrived(self) -> int:
        return max(self.arrived, default=self.decided)

    def begin(self, since: int) -> None:
        """Count broadcasts from `since` on, and no others."""
        self.forget()
        self.since = since
        self.skip_to(since - 1)

    def skip_to(self, k: int) -> None:
        """Discard broadcasts up to k."""
        self.decided = k
        self.arrived = {n: message for n, message in self.arrived.items() if n > k}

    def forget(self) -> None:
        """Discard all that was sent so far: the sender is out of sight."""
        self.since = None
        self.in_flight = []

    def land(self, t: float) -> list[SentInput]:
        """Return the broadcasts delivered by t [s]."""
        landed = [message for arrival, message in self.in_flight if arrival <= t]
        if landed:
            self.in_flight = [flying for flying in self.in_flight if flying[0] > t]
        return landed
