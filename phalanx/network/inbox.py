"""An agent's inbox for broadcasts: all that were sent arrive; the link rule says what it got."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from phalanx.network.claim import Claim
from phalanx.network.link import Link
from phalanx.theory.rows.information import ReceivedInput


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


class Existing(NamedTuple):
    """Which broadcasts of one sender exist for a receiver, as its sample counts them."""

    since: int
    """The first that counts."""
    latest: int
    """The last."""


class _Arrived(NamedTuple):
    """A broadcast that is here."""

    message: SentInput
    at: float | None
    """When it came [s of virtual time], in real time."""


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
        self._arrived: dict[int, dict[int, _Arrived]] = {sender: {} for sender in senders}
        self._make, self._links = link, dict[int, Link]()
        self._override: tuple[float | None, float | None] = None, None
        self._since: dict[int, int] = {}
        """Of the senders in sight: the first broadcast that counts."""
        self._decided = dict.fromkeys(self._arrived, -1)
        self._in_flight: dict[int, list[tuple[float, SentInput]]] = {}
        self._newest = dict.fromkeys(self._arrived, -1)
        self._received: dict[int, ReceivedInput] = {}
        self._corrupt: list[tuple[int, SentInput]] = []

    def override_links(self, loss: float | None, delay: float | None) -> None:
        """Replace loss and delay [s] of every link's model, where given."""
        self._override = loss, delay
        for link in self._links.values():
            link.override(loss, delay)

    @property
    def senders(self) -> list[int]:
        """Whom this inbox listens to."""
        return list(self._arrived)

    def join_at(self, existing: Mapping[int, Existing]) -> None:
        """Begin in the middle of a run: what exists by now will not come any more."""
        for sender, (since, latest) in existing.items():
            self._since[sender] = since
            self._skip_to(sender, latest)

    def put(self, sender: int, message: SentInput, at: float | None = None) -> bool:
        """Keep a broadcast. False if it is from the past or already here: a replay.

        at: when it came [s of virtual time], in real time.
        """
        waiting = self._arrived[sender]
        if message.k <= self._decided[sender] or message.k in waiting:
            return False
        waiting[message.k] = _Arrived(message, at)
        return True

    def missing(self, existing: Mapping[int, Existing]) -> bool:
        """Whether a broadcast that exists by now, by sender, has yet to arrive."""
        return any(
            k not in self._arrived[sender]
            for sender, (since, latest) in existing.items()
            for k in range(max(self._decided[sender] + 1, since), latest + 1)
        )

    def here(self, existing: Mapping[int, Existing]) -> dict[int, Existing]:
        """Of the broadcasts that exist by now, by sender, those up to the newest that is here.

        What is not here by then, in real time, is lost.
        """
        return {
            sender: Existing(since, max([self._decided[sender], *self._arrived[sender]]))
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
        for sender in [sender for sender in self._since if sender not in existing]:
            self._forget(sender)
        fates = []
        for sender, (since, latest) in existing.items():
            if self._since.get(sender) != since:
                self._forget(sender)
                self._since[sender] = since
                self._skip_to(sender, since - 1)
            for k in sorted(k for k in self._arrived[sender] if k <= latest):
                message, at = self._arrived[sender].pop(k)
                # It is sent when the input takes effect, and delays count from then; in real time
                # they come on top of what it took to be here.
                sent = message.t_apply if at is None else max(message.t_apply, min(at, t))
                link = self._link(sender)
                apart = distance(sender) if link.asks_distance else math.nan
                passage = link.fate(k, sent, apart)
                lost = passage.delay is None
                claim = None if lost else Claim(message.t_apply, message.u)
                delay = -1.0 if passage.delay is None else sent - message.t_apply + passage.delay
                fates.append(Fate(sender, k, delay, passage.faults, claim))
                for copy in passage.copies:
                    if copy.corrupt:
                        self._corrupt.append((sender, message))
                    else:
                        flying = self._in_flight.setdefault(sender, [])
                        flying.append((sent + copy.after, message))
            self._decided[sender] = max(self._decided[sender], latest)
            self._deliver(sender, t)
        return tuple(fates)

    def take_corrupt(self) -> list[tuple[int, SentInput]]:
        """Senders and broadcasts of which a copy with a flipped byte has come since last asked."""
        taken, self._corrupt = self._corrupt, []
        return taken

    def received(self) -> Mapping[int, ReceivedInput]:
        """û_l by sender; one never heard since it came into sight is absent."""
        return self._received

    def _forget(self, sender: int) -> None:
        """Nothing that a sender broadcast so far counts any more."""
        self._since.pop(sender, None)
        self._received.pop(sender, None)
        self._in_flight.pop(sender, None)

    def _skip_to(self, sender: int, k: int) -> None:
        """Broadcasts up to k are of the past."""
        self._decided[sender] = k
        arrived = self._arrived[sender]
        self._arrived[sender] = {n: message for n, message in arrived.items() if n > k}

    def _link(self, sender: int) -> Link:
        if sender not in self._links:
            link = self._links[sender] = self._make(sender)
            link.override(*self._override)
        return self._links[sender]

    def _deliver(self, sender: int, t: float) -> None:
        flying = self._in_flight.get(sender, [])
        due = [message for arrival, message in flying if arrival <= t]
        if not due:
            return
        self._in_flight[sender] = [(arrival, message) for arrival, message in flying if arrival > t]
        newest = max(due, key=lambda message: message.k)
        # A slow broadcast may arrive after one that was sent later: the newest counts.
        if newest.k > self._newest[sender]:
            self._newest[sender] = newest.k
            self._received[sender] = ReceivedInput(np.array(newest.u), newest.t_apply)
