"""Messages through a session: who puts them, how they may be dropped, and who is called."""

import threading
import time
from collections.abc import Callable

import zenoh

from phalanx.compat.zenoh_threads import keep_thread_state
from phalanx.wire.session import HubError

_GLANCE = 0.2
"""How often a wait looks up to see whether it is over [s]."""

Deliver = Callable[[str, bytes], None]
Publisher = zenoh.Publisher


def publisher(
    session: zenoh.Session, key: str, priority: zenoh.Priority = zenoh.Priority.DATA
) -> zenoh.Publisher:
    """A publisher whose messages are never dropped by a full queue: lockstep needs them all."""
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.BLOCK,
        reliability=zenoh.Reliability.RELIABLE,
        priority=priority,
    )


def urgent_publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """A publisher whose messages overtake others on their way: the hub allows the plant alone."""
    return publisher(session, key, zenoh.Priority.INTERACTIVE_HIGH)


def view_publisher(
    session: zenoh.Session, key: str, priority: zenoh.Priority = zenoh.Priority.DATA_LOW
) -> zenoh.Publisher:
    """A publisher that drops what a slow listener cannot take: it never holds up who puts."""
    return session.declare_publisher(
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        reliability=zenoh.Reliability.RELIABLE,
        priority=priority,
    )


def notice_publisher(session: zenoh.Session, key: str) -> zenoh.Publisher:
    """A view_publisher whose messages do not wait behind, nor go down with, those of others."""
    return view_publisher(session, key, zenoh.Priority.DATA)


class Addressed:
    """Puts messages on keys that have one listener each, and that nobody else is told of.

    A declared publisher that knows no subscriber sends nothing, and learns of a new one a moment
    late. Without one a client always sends, and the hub routes to whoever is there.
    """

    def __init__(
        self,
        session: zenoh.Session,
        droppable: bool = False,
        priority: zenoh.Priority = zenoh.Priority.DATA,
    ) -> None:
        """droppable: whether a full queue drops a message, or has its sender wait."""
        congestion = zenoh.CongestionControl
        self._session, self._priority = session, priority
        self._congestion = congestion.DROP if droppable else congestion.BLOCK
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
