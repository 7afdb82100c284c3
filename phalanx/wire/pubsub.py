"""Publish, subscribe and query through a session, with a choice of what a full queue drops."""

import threading
import time
from collections.abc import Callable
from enum import Enum

import zenoh

from phalanx.messages.kinds import Message
from phalanx.messages.seal import Sealer
from phalanx.wire.session import HubError
from phalanx.wire.zenoh_sessions import keep_thread_state

_POLL = 0.2
"""Longest single wait [s]."""

Deliver = Callable[[str, bytes], None]
Publisher = zenoh.Publisher


class Delivery(Enum):
    """Congestion control and priority of messages."""

    ALL = zenoh.CongestionControl.BLOCK, zenoh.Priority.DATA
    """Never dropped, for lockstep: a full queue blocks the sender."""
    URGENT = zenoh.CongestionControl.BLOCK, zenoh.Priority.INTERACTIVE_HIGH
    """The same with priority, which the hub allows the plant alone."""
    NOTICE = zenoh.CongestionControl.DROP, zenoh.Priority.DATA
    """Dropped by a full queue: a slow receiver never blocks the sender."""
    VIEW = zenoh.CongestionControl.DROP, zenoh.Priority.DATA_LOW
    """The same in a queue of its own, of lower priority, so that it delays no notices."""


def publisher(
    session: zenoh.Session, key: str, delivery: Delivery = Delivery.ALL
) -> zenoh.Publisher:
    """Declare a publisher of messages under a key expression."""
    congestion, priority = delivery.value
    return session.declare_publisher(
        key,
        congestion_control=congestion,
        reliability=zenoh.Reliability.RELIABLE,
        priority=priority,
    )


class Addressed:
    """Puts messages without a declared publisher, on keys with one subscriber each.

    A declared publisher that knows no subscriber sends nothing, and learns of a new one a moment
    late. Without one a client always sends, and the hub routes to the subscribers of that moment.
    """

    def __init__(self, session: zenoh.Session, delivery: Delivery = Delivery.ALL) -> None:
        self._session, (self._congestion, self._priority) = session, delivery.value
        self._expressions: dict[str, zenoh.KeyExpr] = {}
        """Declared keys, which the hub has by a number: it finds their routes without parsing."""

    def put(self, key: str, payload: bytes) -> None:
        """Put a message."""
        expression = self._expressions.get(key)
        if expression is None:
            expression = self._expressions[key] = self._session.declare_keyexpr(key)
        self._session.put(
            expression, payload, congestion_control=self._congestion, priority=self._priority
        )


class SealedPublisher:
    """Seals messages and puts them under one key expression."""

    def __init__(
        self,
        session: zenoh.Session,
        sealer: Sealer,
        key: str,
        delivery: Delivery = Delivery.ALL,
    ) -> None:
        # zenoh.Publisher.key_expr makes a new object at each access.
        self._key, self._sealer = key, sealer
        self._publisher = publisher(session, key, delivery)

    def put(self, message: Message) -> None:
        """Put a message."""
        self._publisher.put(self._sealer.seal(self._key, message))

    @property
    def heard(self) -> bool:
        """True if there is a subscriber."""
        return has_listener(self._publisher)

    def wait_until_heard(self, timeout: float, over: Callable[[], bool] = lambda: False) -> None:
        """Wait for a subscriber, as wait_for_listener does. Raises HubError."""
        wait_for_listener(self._publisher, timeout, over)


def has_listener(publisher: zenoh.Publisher) -> bool:
    """Return whether a publisher has a subscriber."""
    matching: bool = publisher.matching_status.matching  # type: ignore[attr-defined]
    return matching


def wait_for_listener(
    publisher: zenoh.Publisher, timeout: float, over: Callable[[], bool] = lambda: False
) -> None:
    """Wait until a publisher has a subscriber: messages put earlier are lost.

    Raises HubError if it has none after `timeout` seconds, or when over() is true.
    """
    if has_listener(publisher):
        return
    listener = threading.Event()

    def on_match(status: zenoh.MatchingStatus) -> None:
        if status.matching:
            listener.set()

    publisher.declare_matching_listener(zenoh.handlers.Callback(on_match, indirect=False))
    deadline = time.monotonic() + timeout
    while not has_listener(publisher) and not listener.wait(_POLL):
        if over() or time.monotonic() > deadline:
            raise HubError(f"no subscriber of {publisher.key_expr} after {timeout:g} s")


def subscribe(session: zenoh.Session, key: str, deliver: Deliver) -> None:
    """Call deliver(key, payload) in Zenoh's own thread for every message, until the session closes.

    deliver may put, but must not wait for another message.
    """

    def on_sample(sample: zenoh.Sample) -> None:
        keep_thread_state()
        deliver(str(sample.key_expr), sample.payload.to_bytes())

    session.declare_subscriber(key, zenoh.handlers.Callback(on_sample, indirect=False))


def answer(session: zenoh.Session, key: str, payload: bytes) -> None:
    """Answer every query on the key with the same payload, until the session closes."""

    def on_query(query: zenoh.Query) -> None:
        query.reply(key, payload)

    session.declare_queryable(key, zenoh.handlers.Callback(on_query, indirect=False))


def ask(session: zenoh.Session, key: str, timeout: float) -> bytes | None:
    """Return the first answer to a query on the key, or None after `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while True:
        for reply in session.get(key, timeout=min(timeout, 1.0)):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
        if time.monotonic() > deadline:
            return None
        time.sleep(0.05)  # without a queryable on the key the query ends at once
