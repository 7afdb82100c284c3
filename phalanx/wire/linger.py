"""Connections that are closed at once, even to a peer that takes nothing any more.

Zenoh has the kernel linger for ten seconds at the close of a TCP or TLS connection until the peer
took everything, and closes in one of the few threads that serve all the others: a hub that gave up
a stopped listener would hear nobody for so long. What was sent is delivered without that as well.
"""

import contextlib
import os
import socket
import struct
import threading

import zenoh

_DO_NOT_LINGER = struct.pack("ii", 0, 0)
_TOGETHER = 0.1
"""Connections that come within this are told together [s]: each time all sockets are looked at."""


def close_at_once(session: zenoh.Session) -> None:
    """Have this process's connections not linger, soon after each is there."""
    told_soon = threading.Event()

    def tell() -> None:
        told_soon.clear()
        _linger_nowhere()

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT and not told_soon.is_set():
            timer = threading.Timer(_TOGETHER, tell)
            timer.daemon = True
            told_soon.set()
            try:
                timer.start()
            except RuntimeError:  # there may be no more threads
                tell()

    session.info.declare_transport_events_listener(on_event, history=True)


def _linger_nowhere() -> None:
    """Zenoh tells nobody which descriptor is whose, so all sockets are told."""
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):  # closed by now, or not a socket
            connection = socket.socket(fileno=descriptor)
            try:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _DO_NOT_LINGER)
            finally:
                connection.detach()  # it is Zenoh's to close
