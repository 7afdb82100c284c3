"""Receive the messages of a run without taking part, decoded without their types."""

import queue
from collections.abc import Iterator
from typing import Any

import msgpack

from phalanx.messages.keys import PLANT
from phalanx.messages.membership import Membership
from phalanx.messages.seal import SEAL_BYTES
from phalanx.wire.liveliness import is_announced, watch
from phalanx.wire.pubsub import subscribe
from phalanx.wire.session import HubError, open_client


def tapped(membership: Membership, kind: str = "*") -> Iterator[Any]:
    """Yield (key expression, fields) of each message of a run, until the plant leaves.

    A payload that is not msgpack under a seal is yielded as bytes. A caller that is too slow loses
    messages: no sender waits for a tap.

    Args:
        membership: of the run, as a viewer.
        kind: of the messages, as in their key expressions; "*" for all.

    Raises:
        HubError: the hub cannot be reached, or no such run is there.
    """
    keys, timeout = membership.keys, membership.timeout
    arrived: queue.SimpleQueue[tuple[str, bytes] | None] = queue.SimpleQueue()
    with open_client(membership.endpoint, timeout, membership.credentials) as session:
        for every in keys.to_viewers if kind == "*" else (keys.for_viewers(kind),):
            subscribe(session, every, lambda key, payload: arrived.put((key, payload)))
        watch(session, keys.alive(PLANT), lambda _, alive: None if alive else arrived.put(None))
        # After the watch: a plant that leaves meanwhile is missed by one of the two at most.
        if not is_announced(session, keys.alive(PLANT), timeout):
            where = f"at {membership.endpoint} within {timeout:.3g} s"
            raise HubError(f"no run {membership.run} {where}: is that its name?")
        while (message := arrived.get()) is not None:
            key, payload = message
            yield keys.original(key), decoded(payload)


def decoded(payload: bytes) -> Any:
    """Return the fields of a message, or its bytes if it is not msgpack under a seal."""
    try:
        return msgpack.unpackb(payload[SEAL_BYTES:], object_pairs_hook=_named)
    except (ValueError, msgpack.UnpackException):
        return payload


def _named(fields: list[tuple[str | bytes, Any]]) -> dict[str, Any]:
    """Make the names of a map texts, as JSON needs them: in msgpack they may be bytes."""
    return {str(name): value for name, value in fields}
