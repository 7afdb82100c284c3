"""Close connections at once, even to a peer that takes nothing any more.

Zenoh 1.10 has the kernel linger for ten seconds at the close of a TCP or TLS connection until the
peer took everything, and closes in one of the few threads that serve all the others: a hub that
gave up a stopped listener would hear nobody for so long. What was sent is delivered without that
as well.

Upstream: eclipse-zenoh/zenoh#2349 keeps `set_linger` although tokio-rs/tokio#7751 deprecates it,
because the close may block. An option of the link for it would replace this file.
"""

import contextlib
import os
import socket
import struct
import threading

import zenoh

_DO_NOT_LINGER = struct.pack("ii", 0, 0)
_TOGETHER = 0.1
"""Connections that are made within this time are changed at once [s]."""


def close_at_once(session: zenoh.Session) -> None:
    """Have this process's connections not linger, soon after each is made."""
    scheduled = threading.Event()

    def change() -> None:
        scheduled.clear()
        _linger_nowhere()

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT and not scheduled.is_set():
            timer = threading.Timer(_TOGETHER, change)
            timer.daemon = True
            scheduled.set()
            try:
                timer.start()
            except RuntimeError:  # there may be no more threads
                change()

    session.info.declare_transport_events_listener(on_event, history=True)


def _linger_nowhere() -> None:
    """Change every socket of the process: Zenoh does not say which descriptor is whose."""
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        with contextlib.suppress(OSError):  # closed by now, or not a socket
            connection = socket.socket(fileno=descriptor)
            try:
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _DO_NOT_LINGER)
            finally:
                connection.detach()  # it is Zenoh's to close
