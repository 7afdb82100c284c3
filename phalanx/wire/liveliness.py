"""Who is there: tokens that disappear with the session that declared them."""

import time
from collections.abc import Callable

import zenoh


def announce(session: zenoh.Session, key: str) -> zenoh.LivelinessToken:
    """Declare a liveliness token; it disappears with the session, whatever ends it."""
    return session.liveliness().declare_token(key)


def is_announced(session: zenoh.Session, token: str, timeout: float) -> bool:
    """Whether a liveliness token is there, or appears within `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while (left := deadline - time.monotonic()) > 0:
        if any(reply.ok is not None for reply in session.liveliness().get(token, timeout=left)):
            return True
        time.sleep(0.05)  # nobody has announced himself yet, so the query ended at once
    return False


def watch(session: zenoh.Session, key: str, changed: Callable[[str, bool], None]) -> None:
    """Call changed(key, alive) whenever a liveliness token appears or disappears.

    It is called in Zenoh's own thread, so it must neither close nor wait.
    """

    def on_token(sample: zenoh.Sample) -> None:
        changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    callback = zenoh.handlers.Callback(on_token, indirect=False)
    session.liveliness().declare_subscriber(key, callback, history=True)


def on_parting(session: zenoh.Session, parted: Callable[[], None]) -> None:
    """Call parted() when the hub is gone, at once if it is gone already.

    A liveliness token says so too, but only to who had seen it before.
    """

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE:
            parted()

    session.info.declare_transport_events_listener(
        zenoh.handlers.Callback(on_event, indirect=False)
    )
    if not session.info.transports():
        parted()
