"""Ports for hubs: many runs that start at once get one each, and keep it until they listen."""

import contextlib
import os
import socket
import subprocess
import sys

import pytest

from phalanx.wire import session
from phalanx.wire.session import open_hub, reserved_endpoint

MANY = 100


def port_of(endpoint: str) -> int:
    return int(endpoint.rsplit(":", 1)[1])


def any_port() -> int:
    """Return a port that the kernel chooses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_a_reserved_endpoint_is_given_to_no_other_run():
    with contextlib.ExitStack() as runs:
        reserved = [port_of(runs.enter_context(reserved_endpoint())) for _ in range(MANY)]
        assert len(set(reserved)) == MANY
        assert not {any_port() for _ in range(20 * MANY)} & set(reserved)


def test_a_hub_can_listen_where_an_endpoint_is_reserved():
    with reserved_endpoint() as endpoint, open_hub(endpoint):
        host = ("127.0.0.1", port_of(endpoint))
        socket.create_connection(host, timeout=5.0).close()


HUB = """
import time
from pathlib import Path
from phalanx.wire.session import reserved_endpoint
from phalanx.wire.session import open_hub
with reserved_endpoint() as endpoint, open_hub(endpoint):
    names, deadline = "", time.monotonic() + 5.0
    while "acc-0" not in names and time.monotonic() < deadline:  # a thread names itself
        names = " ".join(file.read_text() for file in Path("/proc/self/task").glob("*/comm"))
    print(names)
"""


@pytest.mark.slow
def test_a_hub_that_a_client_started_does_not_forward_in_the_clients_single_thread():
    """Without this a flood of one agent's peer blocked all programs while it lasted."""
    environment = {**os.environ, session._RUNTIME: session._CLIENT_RUNTIME}
    ran = subprocess.run(
        [sys.executable, "-c", HUB], env=environment, capture_output=True, text=True, check=True
    )
    assert "acc-0" in ran.stdout, "a thread of its own for who comes"
