"""An agent's inbox for broadcasts: all that were sent arrive; the link rule says what it got."""

import math
from collections.abc import Callable, Iterable, Mapping, Set
from typing import NamedTuple

import msgspec

from phalanx.network.claim import Claim
from phalanx.network.incoming import Incoming, SentInput
from phalanx.network.link import Link


class Existing(NamedTuple):
    """Which broadcasts of one sender exist for a receiver, as its sample counts them."""

    since: int
    """The first that counts."""
    latest: int
    """The last."""


class Fate(msgspec.Struct, array_like=True, frozen=True):
    """What the network did to one broadcast on its way to the agent that tells of it."""

    sender: int
    k: int
    delay: float
    """Of the first copy that can be read [s]; negative if there is none: lost."""
    faults: tuple[int, ...] = ()
    """Which of the faults that the scenario declares had a part in it, by number."""
    claim: Claim | None = None
    """What it said; nothing if it was lost."""


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
        """Whom this inbox listens to."""
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
