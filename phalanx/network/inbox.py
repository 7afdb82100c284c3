"""An agent's inbox for broadcasts: all that were sent arrive; the link rule says what it got."""

from collections.abc import Mapping
from typing import Protocol

import msgspec
import numpy as np

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


class Fate(msgspec.Struct, array_like=True, frozen=True):
    """What the network did to one broadcast on its way to the agent that tells of it."""

    sender: int
    k: int
    delay: float
    """[s]; negative: lost."""


class BroadcastInbox:
    """Broadcasts of the other agents, in the order of their sequence numbers.

    Real messages come as the transport brings them, after or before the sample that counts them.
    What the agent may know at t is decided here, by the link rule alone, so that delay and loss
    are exact and the machine's load has no part in them.
    """

    def __init__(self, links: Mapping[int, Link]) -> None:
        """links: by sender's index; others are not listened to."""
        self._links = links
        self._arrived: dict[int, dict[int, SentInput]] = {sender: {} for sender in links}
        self._decided = dict.fromkeys(links, -1)
        self._in_flight: dict[int, list[tuple[float, SentInput]]] = {s: [] for s in links}
        self._newest = dict.fromkeys(links, -1)
        self._received: dict[int, ReceivedInput] = {}

    def override_links(self, loss: float | None, delay: float | None) -> None:
        """Replace loss and delay [s] of every link's model, where given."""
        for link in self._links.values():
            link.override(loss, delay)

    @property
    def senders(self) -> list[int]:
        """Whom this inbox listens to."""
        return list(self._links)

    def join_at(self, latest: tuple[int, ...]) -> None:
        """Begin in the middle of a run: what was sent up to `latest` will not come any more."""
        for sender in self._links:
            self._decided[sender] = latest[sender]
            self._arrived[sender] = {
                k: message for k, message in self._arrived[sender].items() if k > latest[sender]
            }

    def put(self, sender: int, message: SentInput) -> bool:
        """Keep a broadcast. False if it is from the past or already here: a replay."""
        waiting = self._arrived[sender]
        if message.k <= self._decided[sender] or message.k in waiting:
            return False
        waiting[message.k] = message
        return True

    def missing(self, latest: tuple[int, ...]) -> bool:
        """Whether a broadcast that exists by now, up to k = latest[sender], has yet to arrive."""
        return any(
            k not in self._arrived[sender]
            for sender, decided in self._decided.items()
            for k in range(decided + 1, latest[sender] + 1)
        )

    def advance(self, latest: tuple[int, ...], t: float) -> tuple[Fate, ...]:
        """Decide every broadcast up to `latest`, and deliver those due by t [s].

        Returns the fates of those decided now. Of several delivered, the newest counts.
        """
        fates = []
        for sender, link in self._links.items():
            for k in range(self._decided[sender] + 1, latest[sender] + 1):
                message = self._arrived[sender].pop(k)
                delay = link.fate(k)
                fates.append(Fate(sender, k, -1.0 if delay is None else delay))
                if delay is not None:
                    # A delay counts from when the input takes effect: it is sent then.
                    self._in_flight[sender].append((message.t_apply + delay, message))
            self._decided[sender] = max(self._decided[sender], latest[sender])
            self._deliver(sender, t)
        return tuple(fates)

    def received(self) -> Mapping[int, ReceivedInput]:
        """û_l by sender; a sender never heard is absent."""
        return self._received

    def _deliver(self, sender: int, t: float) -> None:
        due = [message for arrival, message in self._in_flight[sender] if arrival <= t]
        if not due:
            return
        self._in_flight[sender] = [
            (arrival, message) for arrival, message in self._in_flight[sender] if arrival > t
        ]
        newest = max(due, key=lambda message: message.k)
        # A slow broadcast may arrive after one that was sent later: the newest counts.
        if newest.k > self._newest[sender]:
            self._newest[sender] = newest.k
            self._received[sender] = ReceivedInput(np.array(newest.u), newest.t_apply)
