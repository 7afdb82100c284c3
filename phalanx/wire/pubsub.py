"""Messages through a session: how they may be dropped, who is called, and queries."""

import threading
import time
from collections.abc import Callable
from enum import Enum
from functools import cache

import zenoh

from phalanx.compat.zenoh_threads import keep_thread_state
from phalanx.wire.keys import Keys
from phalanx.wire.messages import Message
from phalanx.wire.seal import Sealer
from phalanx.wire.session import HubError

_GLANCE = 0.2
"""How often a wait looks up to see whether it is over [s]."""

Deliver = Callable[[str, bytes], None]
Publisher = zenoh.Publisher


class Delivery(Enum):
    """What a full queue does with a message, and which others it goes before."""

    ALL = zenoh.CongestionControl.BLOCK, zenoh.Priority.DATA
    """None is ever dropped: lockstep needs them all."""
    URGENT = zenoh.CongestionControl.BLOCK, zenoh.Priority.INTERACTIVE_HIGH
    """The same, and they overtake others on their way: the hub allows the plant alone."""
    NOTICE = zenoh.CongestionControl.DROP, zenoh.Priority.DATA
    """What a slow listener cannot take is dropped: it never holds up who puts."""
    VIEW = zenoh.CongestionControl.DROP, zenoh.Priority.DATA_LOW
    """The same, behind all others: notices neither wait behind them, nor go down with them."""


def publisher(
    session: zenoh.Session, key: str, delivery: Delivery = Delivery.ALL
) -> zenoh.Publisher:
    """A publisher of messages under a key expression."""
    congestion, priority = delivery.value
    return session.declare_publisher(
        key,
        congestion_control=congestion,
        reliability=zenoh.Reliability.RELIABLE,
        priority=priority,
    )


class Addressed:
    """Puts messages on keys that have one listener each, and that nobody else is told of.

    A declared publisher that knows no subscriber sends nothing, and learns of a new one a moment
    late. Without one a client always sends, and the hub routes to whoever is there.
    """

    def __init__(self, session: zenoh.Session, delivery: Delivery = Delivery.ALL) -> None:
        self._session, (self._congestion, self._priority) = session, delivery.value
        self._known: dict[str, zenoh.KeyExpr] = {}
        """What the hub knows by a number: it finds their routes without reading them again."""

    def put(self, key: str, payload: bytes) -> None:
        """Put a message."""
        known = self._known.get(key)
        if known is None:
            known = self._known[key] = self._session.declare_keyexpr(key)
        self._session.put(
            known, payload, congestion_control=self._congestion, priority=self._priority
        )


class SealedPublisher:
    """Seals messages, and puts them under one key expression."""

    def __init__(
        self,
        session: zenoh.Session,
        sealer: Sealer,
        key: str,
        delivery: Delivery = Delivery.ALL,
        copies: "Copies | None" = None,
    ) -> None:
        """copies: puts each of them once more, for those who look on."""
        # A publisher's own key expression is made anew each time it is asked for.
        self._key, self._sealer, self._copies = key, sealer, copies
        self._publisher = publisher(session, key, delivery)

    def put(self, message: Message) -> None:
        """Put a message."""
        payload = self._sealer.seal(self._key, message)
        self._publisher.put(payload)
        if self._copies:
            self._copies.put(self._key, payload)

    @property
    def heard(self) -> bool:
        """Whether somebody listens now."""
        return has_listener(self._publisher)

    def wait_until_heard(self, timeout: float, over: Callable[[], bool] = lambda: False) -> None:
        """Wait until somebody listens, as wait_for_listener does. Raises HubError."""
        wait_for_listener(self._publisher, timeout, over)


def has_listener(publisher: zenoh.Publisher) -> bool:
    """Whether somebody listens now."""
    matching: bool = publisher.matching_status.matching  # type: ignore[attr-defined]
    return matching


def wait_for_listener(
    publisher: zenoh.Publisher, timeout: float, over: Callable[[], bool] = lambda: False
) -> None:
    """Wait until somebody listens: messages put earlier are lost.

    Raises HubError if nobody does within `timeout` seconds, or `over` before.
    """
    if has_listener(publisher):
        return
    listener = threading.Event()

    def on_match(status: zenoh.MatchingStatus) -> None:
        if status.matching:
            listener.set()

    publisher.declare_matching_listener(zenoh.handlers.Callback(on_match, indirect=False))
    deadline = time.monotonic() + timeout
    while not has_listener(publisher) and not listener.wait(_GLANCE):
        if over() or time.monotonic() > deadline:
            raise HubError(f"nobody listens to {publisher.key_expr} after {timeout:g} s")


def subscribe(session: zenoh.Session, key: str, deliver: Deliver) -> None:
    """Call deliver(key, payload) in Zenoh's own thread for every message, until the close.

    deliver may put, but must not wait for another message.
    """

    def on_sample(sample: zenoh.Sample) -> None:
        keep_thread_state()
        deliver(str(sample.key_expr), sample.payload.to_bytes())

    session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False))


class Copies:
    """What one program puts, put once more for those who look on, while somebody does.

    Samples, actuations, broadcasts and telemetry are put so that none is lost, and so who gets them
    can make their senders wait. Viewers get copies instead, which are dropped where they are not
    taken: a reader that stops holds up nobody.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, every: str) -> None:
        """every: a key expression that includes all of which there may be copies."""
        self._copy = cache(keys.copy)
        self._addressed = Addressed(session, Delivery.VIEW)
        self._readers = publisher(session, keys.copy(every), Delivery.VIEW)
        self._wanted = False
        on_match = zenoh.handlers.Callback(self._on_match, indirect=False)
        self._readers.declare_matching_listener(on_match)

    def look_for_readers(self) -> None:
        """Find those who came before, of whom nothing is told."""
        self._wanted = has_listener(self._readers)

    def put(self, key: str, payload: bytes) -> None:
        """Put a copy of what was put on a key, if anybody looks on."""
        if self._wanted:
            self._addressed.put(self._copy(key), payload)

    def _on_match(self, status: zenoh.MatchingStatus) -> None:
        self._wanted = status.matching


def answer(session: zenoh.Session, key: str, payload: bytes) -> None:
    """Answer every query on the key with the same payload, until the close."""
    answer_each(session, key, lambda _: payload)


def answer_each(session: zenoh.Session, key: str, reply: Callable[[bytes], bytes | None]) -> None:
    """Answer each query on the key by what it asks, in Zenoh's own thread; None: not at all."""

    def on_query(query: zenoh.Query) -> None:
        payload = reply(query.payload.to_bytes() if query.payload else b"")
        if payload is not None:
            query.reply(key, payload)

    session.declare_queryable(key, zenoh.handlers.Callback(on_query, indirect=False))


def ask(
    session: zenoh.Session, key: str, timeout: float, question: bytes | None = None
) -> bytes | None:
    """The first answer to a query on the key, or None within `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while True:
        for reply in session.get(key, payload=question, timeout=min(timeout, 1.0)):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        if time.monotonic() > deadline:
            return None
        time.sleep(0.05)  # nobody has declared the key yet, so the query ended at once
