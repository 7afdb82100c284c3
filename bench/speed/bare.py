"""Programs without any computation, which join a hub as those of a run do and forward payloads."""

import contextlib
import threading
import time
from collections.abc import Iterator, Sequence
from queue import SimpleQueue
from typing import NamedTuple

from phalanx.messages.keys import PLANT, Keys, kind_and_name
from phalanx.wire import liveliness, pubsub
from phalanx.wire.session import Session, open_hub, open_member

KEYS = Keys("bench")
PATIENCE = 120.0
"""Longest wait of one program for another [s]."""


class Hub(NamedTuple):
    """A hub that all members have joined."""

    samples: list[pubsub.Publisher]
    """To each member, in order."""
    actuations: SimpleQueue[bytes]
    """Payloads from members, in order of arrival."""


@contextlib.contextmanager
def hub(endpoint: str, names: Sequence[str]) -> Iterator[Hub]:
    """Open a hub and wait for all members, which leave after the block.

    Raises queue.Empty if none joins for PATIENCE.
    """
    joined: SimpleQueue[str] = SimpleQueue()
    actuations: SimpleQueue[bytes] = SimpleQueue()
    with open_hub(endpoint) as session:
        samples = [
            pubsub.publisher(session, KEYS.sample(name), pubsub.Delivery.URGENT) for name in names
        ]
        pubsub.subscribe(session, KEYS.actuation("*"), lambda _, payload: actuations.put(payload))
        pubsub.subscribe(session, KEYS.telemetry("*"), lambda _key, _payload: None)
        liveliness.watch(session, KEYS.alive("*"), lambda key, _: joined.put(kind_and_name(key)[1]))
        _token = liveliness.announce(session, KEYS.alive(PLANT, "bench"))
        missing = {*names, PLANT}
        while missing:
            missing.discard(joined.get(timeout=PATIENCE))
        yield Hub(samples, actuations)


def exchange(hub: Hub, payload: bytes, count: int) -> float:
    """Measure the time from a sample to its actuation, one member after the other [s]."""
    began = time.perf_counter()
    for k in range(count):
        hub.samples[k % len(hub.samples)].put(payload)
        hub.actuations.get(timeout=PATIENCE)
    return (time.perf_counter() - began) / count


@contextlib.contextmanager
def member(endpoint: str, name: str) -> Iterator[Session]:
    """Open a session for the block's declarations; then join, and stay until the hub leaves."""
    with open_member(endpoint, KEYS.alive(PLANT), PATIENCE) as session:
        yield session
        over = threading.Event()
        liveliness.watch(session, KEYS.alive(PLANT), lambda _, alive: None if alive else over.set())
        _token = liveliness.announce(session, KEYS.alive(name, "bench"))
        over.wait()
