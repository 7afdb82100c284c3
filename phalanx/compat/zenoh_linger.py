"""Close connections without lingering, even to a peer that does not read any more.

Zenoh 1.10 lets the kernel linger for up to ten seconds at the close of a TCP or TLS connection
until the peer has read everything. It closes in one of the few threads that serve all connections:
a hub that closes the connection of a stopped listener would block for that time. Messages sent
before are delivered without lingering too.

Upstream: eclipse-zenoh/zenoh#2349 keeps `set_linger` although tokio-rs/tokio#7751 deprecates it,
because the close may block. An option of the link would replace this file.
"""

import contextlib
import os
import socket
import struct
import threading

import zenoh

_DO_NOT_LINGER = struct.pack("ii", 0, 0)
_DELAY = 0.1
"""Connections that are made within this time are changed together [s]."""


def disable_linger(session: zenoh.Session) -> None:
    """Disable lingering of this process's connections, soon after each is made."""
    scheduled = threading.Event()

    def change() -> None:
        scheduled.clear()
        _linger_nowhere()

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT and not scheduled.is_set():
            timer = threading.Timer(_DELAY, change)
            timer.daemon = True
            scheduled.set()
            try:
                timer.start()
            except RuntimeError:  # the process may have no more threads
                change()

    session.info.declare_transport_events_listener(on_event, history=True)


def _linger_nowhere() -> None:
    """Change every socket of the process: Zenoh does not expose its descriptors."""
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):  # closed by now, or not a socket
            connection = socket.socket(fileno=descriptor)
            try:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _DO_NOT_LINGER)
            finally:
                connection.detach()  # Zenoh closes it
