"""Endpoints on loopback that are free."""

import contextlib
import socket
from collections.abc import Iterator


def free_endpoint() -> str:
    """A TCP endpoint on loopback that is free now."""
    with reserved_endpoint() as endpoint:
        return endpoint


@contextlib.contextmanager
def reserved_endpoint() -> Iterator[str]:
    """A TCP endpoint on loopback that nobody else is given while the block runs."""
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        # Bound without it, so that the kernel gives the port to nobody who asks for any; with it
        # from now on, so that a hub, which asks for this one, may listen beside a socket that
        # does not.
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield f"tcp/127.0.0.1:{holder.getsockname()[1]}"
