"""Questions through a session, and their answers."""

import time
from collections.abc import Callable

import zenoh


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
