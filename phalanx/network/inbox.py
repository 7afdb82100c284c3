"""An agent's inbox: all broadcasts arrive; the link rules decide which of them it has received."""

import math
from collections.abc import Callable, Iterable, Mapping, Set
from operator import itemgetter
from types import MappingProxyType
from typing import Protocol

import msgspec

from phalanx.network.link import Link
from phalanx.theory.rows.information import ReceivedInput


class AnnouncedInput(msgspec.Struct, array_like=True, frozen=True):
    """A broadcast's statement of its sender's input and, by radio, state, true or not."""

    t_apply: float
    """Time from which the input is in force [s]."""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""
    x: tuple[float, ...] = ()
    """Its state at the sample, shape (n_i,); by radio."""


class Statement(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """A broadcast of another agent, as its relay repeats it."""

    sender: int
    """Index of the agent that made it."""
    k: int
    """Number of the sample that it answers."""
    t_apply: float
    """Time from which the input is in force [s]."""
    u: tuple[float, ...]
    """Native input, shape (m_l,)."""
    t: float
    """Time of the sample [s]."""
    x: tuple[float, ...]
    """State at the sample, shape (n_l,)."""
    z: tuple[float, ...]
    """Reference state at the sample, which the state follows in spite of φ, shape (n_l,)."""


class SentInput(ReceivedInput, Protocol):
    """A statement as the inbox needs it; it is sent when its input takes effect."""

    @property
    def k(self) -> int:
        """Its sequence number."""

    @property
    def t(self) -> float:
        """Time of its sample [s]; by radio."""

    @property
    def x(self) -> tuple[float, ...]:
        """State at the sample; by radio."""

    @property
    def z(self) -> tuple[float, ...]:
        """Reference state at the sample; by radio."""


class SentBroadcast(SentInput, Protocol):
    """A broadcast as the inbox needs it."""

    @property
    def relays(self) -> tuple[Statement, ...]:
        """Statements of others."""


BroadcastRange = tuple[int, int]
"""First and last number of one sender's broadcasts that a receiver's sample counts."""


class DeliveryReport(msgspec.Struct, array_like=True, frozen=True):
    """A receiver's report on one broadcast: received or lost."""

    sender: int
    k: int
    delay: float
    """Delay of the first intact copy [s]; negative if there is none: lost."""
    faults: tuple[int, ...] = ()
    """Numbers of the declared faults that had an effect on it."""
    claim: AnnouncedInput | None = None
    """Its claim; None if it was lost."""


class Conviction(msgspec.Struct, array_like=True, frozen=True):
    """A finding that an agent did not hold the inputs that it announced, or lied on its states."""

    of: int
    """Index of the agent."""
    begin: float
    """First sample of the window [s]; by radio, time of the last state believed."""
    end: float
    """Second sample of the window [s]; by radio, stated time of the one that contradicts it."""
    excess: float
    """By how much more than φ^max it takes to explain the motion, in units of x'; by radio, how far
    off the state is [m]."""


class BroadcastInbox:
    """Broadcasts of the other agents, in the order of their sequence numbers.

    The transport delivers the real messages at any time, after or before the sample that counts
    them. The link rules alone decide what the agent has received at t, so that delay and loss are
    exact and independent of the machine's load.

    A sender whose broadcasts a sample does not count is out of sight: its earlier inputs are
    discarded, and only broadcasts that it sends after its return count. What a peer by radio said
    is never discarded.
    """

    def __init__(
        self,
        senders: Iterable[int],
        link: Callable[[int], Link],
        peers: Mapping[int, int] = MappingProxyType({}),
        stamp_error: float = 0.0,
    ) -> None:
        """Accept broadcasts of some senders only.

        Args:
            senders: their indices.
            link: creates the link from a sender, at its first broadcast: in a large swarm most
                senders stay out of sight.
            peers: of the senders those known by radio, each with its samples per broadcast.
            stamp_error: bound on the error of a stated time [s].
        """
        self._incoming = {sender: Incoming(peers.get(sender, 1)) for sender in senders}
        self._peers, self._stamp_error = peers.keys(), stamp_error
        self._make_link = link
        self._override: tuple[float | None, float | None] = None, None
        self._in_sight: Set[int] = frozenset()
        self._in_flight: list[tuple[float, int, SentBroadcast]] = []
        """Copies not delivered yet, each with its time of delivery [s] and its sender."""
        self.received: dict[int, SentInput] = {}
        """The newest statement by sender, of those received since it came into sight."""
        self.delivered: list[tuple[int, SentBroadcast]] = []
        """All intact broadcasts that the last call of advance delivered, with their senders."""
        self.corrupt: list[tuple[int, SentBroadcast]] = []
        """The corrupt copies of those it decided: their senders, and the intact messages."""

    def override_links(self, loss: float | None, delay: float | None) -> None:
        """Replace loss and delay [s] of every link's model, where given."""
        self._override = loss, delay
        for incoming in self._incoming.values():
            if incoming.link:
                incoming.link.override(loss, delay)

    def join_at(self, counted: Mapping[int, BroadcastRange]) -> None:
        """Begin in the middle of a run: broadcasts sent so far, by sender, will not arrive."""
        for sender, (since, latest) in counted.items():
            incoming = self._incoming[sender]
            incoming.since = since
            incoming.skip_to(latest)
        self._in_sight = counted.keys()

    def put(self, sender: int, message: SentBroadcast, at: float = -math.inf) -> bool:
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
        gaps = {sender: self._incoming[sender].missing(*n) for sender, n in counted.items()}
        return {sender: numbers for sender, numbers in gaps.items() if numbers}

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
    ) -> tuple[DeliveryReport, ...]:
        """Decide every counted broadcast, by sender, and deliver those due by t [s].

        Returns reports on those decided now. If several are delivered, the newest is kept.
        distance: to a sender, at the sample that first counts its broadcast [m].
        """
        in_sight, self.delivered, self.corrupt = counted.keys(), [], []
        for sender in self._in_sight - in_sight:
            self._forget(sender)
        self._in_sight = in_sight
        fates: list[DeliveryReport] = []
        for sender, (since, latest) in counted.items():
            incoming = self._incoming[sender]
            if incoming.since != since:
                self._forget(sender)
                incoming.begin(since)
            if latest > incoming.decided:
                fates += self._decide(sender, latest, t, distance)
        if self._in_flight:
            self._deliver(t)
        return tuple(fates)

    def _forget(self, sender: int) -> None:
        """Discard all that was sent so far: the sender is out of sight."""
        self._incoming[sender].since = None
        self._in_flight = [copy for copy in self._in_flight if copy[1] != sender]
        if sender not in self._peers:
            self.received.pop(sender, None)

    def _deliver(self, t: float) -> None:
        """Deliver the copies due by t [s], by sender."""
        due = [(sender, message) for at, sender, message in self._in_flight if at <= t]
        if not due:
            return
        self._in_flight = [copy for copy in self._in_flight if copy[0] > t]
        due.sort(key=_SENDER)
        self.delivered = due
        for sender, message in due:
            self._keep(sender, message, t)
            for statement in message.relays:
                if statement.sender in self._peers:
                    self._keep(statement.sender, statement, t)

    def _keep(self, sender: int, message: SentInput, t: float) -> None:
        incoming, newest = self._incoming[sender], (message.t, message.k)
        # A slow one may come after one that was sent later; one of the future is a lie.
        if message.t <= t + self._stamp_error and newest > incoming.newest:
            incoming.newest, self.received[sender] = newest, message

    def _decide(
        self, sender: int, latest: int, t: float, distance: Callable[[int], float]
    ) -> list[DeliveryReport]:
        """Decide a sender's broadcasts up to the latest, in order, at t [s]."""
        fates, incoming = [], self._incoming[sender]
        link = incoming.link or self._new_link(sender)
        separation = distance(sender) if link.asks_distance else math.nan
        first, incoming.decided = incoming.decided + 1, latest
        for k in range(first, latest + 1):
            if k not in incoming.arrived:  # in real time it is lost
                continue
            message, at = incoming.arrived.pop(k)
            # It is sent when the input takes effect, and delays count from then; in real time
            # they are added to the real delay.
            begins = message.t_apply
            sent = begins if at <= begins else max(begins, min(at, t))
            # Rules count messages: a burst is of so many in a row, however rare these are.
            delivery = link.fate(k // incoming.every, sent, separation, t)
            after = math.inf
            for copy in delivery.copies:
                if copy.corrupt:
                    self.corrupt.append((sender, message))
                else:
                    after = copy.after if copy.after < after else after
                    self._in_flight.append((sent + copy.after, sender, message))
            if after == math.inf:
                fates.append(DeliveryReport(sender, k, -1.0, delivery.faults))
            else:
                claim = AnnouncedInput(begins, message.u, message.x)
                fates.append(
                    DeliveryReport(sender, k, sent - begins + after, delivery.faults, claim)
                )
        return fates

    def _new_link(self, sender: int) -> Link:
        link = self._incoming[sender].link = self._make_link(sender)
        link.override(*self._override)
        return link


_SENDER = itemgetter(0)


class Incoming:
    """Broadcasts of one sender: those arrived, those decided, and the newest delivered."""

    __slots__ = ("arrived", "decided", "every", "link", "newest", "since")

    def __init__(self, every: int) -> None:
        """every: samples from one of its broadcasts to the next."""
        self.every = every
        self.link: Link | None = None
        """Of the sender, made when its first broadcast is decided."""
        self.since: int | None = None
        """The first broadcast that counts; None while the sender is out of sight."""
        self.decided = -1
        """The last broadcast that the link has decided."""
        self.arrived: dict[int, tuple[SentBroadcast, float]] = {}
        """By number: broadcasts not decided yet, each with its time of arrival [s]."""
        self.newest = (-math.inf, -1)
        """Of the newest broadcast delivered: time [s], 0 without a radio, and number."""

    def missing(self, since: int, latest: int) -> list[int]:
        """Return the numbers in this range that are neither decided nor stored."""
        first = -(-max(self.decided + 1, since) // self.every) * self.every
        return [k for k in range(first, latest + 1, self.every) if k not in self.arrived]

    def newest_arrived(self) -> int:
        return max(self.arrived, default=self.decided)

    def begin(self, since: int) -> None:
        """Count broadcasts from `since` on, and no others."""
        self.since = since
        self.skip_to(since - 1)

    def skip_to(self, k: int) -> None:
        """Discard broadcasts up to k."""
        self.decided = k
        self.arrived = {n: message for n, message in self.arrived.items() if n > k}
