"""Zenoh 1.10: close connections without lingering, and keep Python's state of its threads.

`disable_linger`: Zenoh lets the kernel linger for up to ten seconds at the close of a TCP or TLS
connection until the peer has read everything. It closes in one of the few threads that serve all
connections: a hub that closes the connection of a stopped listener would block for that time.
Messages sent before are delivered without lingering too. Upstream: eclipse-zenoh/zenoh#2349 keeps
`set_linger` although tokio-rs/tokio#7751 deprecates it, because the close may block. An option of
the link would replace it.

`keep_thread_state`: zenoh-python attaches to the interpreter for each callback and detaches after
it: for every message a thread state and its stack are allocated and freed (memory mapped and
unmapped). Upstream has no issue yet. Its text: "Threads of the runtime that call Python should hold
one PyGILState reference for their lifetime; with `indirect=False` each message now costs a
PyThreadState_New and PyThreadState_Delete."
"""

import contextlib
import ctypes
import os
import socket
import struct
import threading

import zenoh

_DO_NOT_LINGER = struct.pack("ii", 0, 0)
_DELAY = 0.1
"""Connections that are made within this time are changed together [s]."""
_thread_states = threading.local()


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


def keep_thread_state() -> None:
    """Keep the calling thread's state by one reference that is never released."""
    if not hasattr(_thread_states, "state"):
        _thread_states.state = ctypes.pythonapi.PyGILState_Ensure()
