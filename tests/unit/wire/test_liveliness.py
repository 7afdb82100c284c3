"""An agent leaves with the plant, and not with a router that comes back."""

import contextlib
import os
import socket
import subprocess
import sys
import threading

import pytest

from phalanx.wire import session
from phalanx.wire.liveliness import PlantPresence
from phalanx.wire.session import open_hub, reserved_endpoint

PATIENCE = 0.05


@pytest.fixture
def presence():
    reasons, departure = [], threading.Event()

    def leave(why: str) -> None:
        reasons.append(why)
        departure.set()

    presence = PlantPresence(PATIENCE, leave)
    presence.reasons, presence.departure = reasons, departure
    presence.on_plant("", True)
    return presence


def test_without_a_router_the_hub_is_the_plant(presence) -> None:
    presence.on_disconnect()
    assert presence.reasons == ["the connection to the hub was lost"]


def test_before_the_first_sample_a_hub_that_comes_back_was_not_lost() -> None:
    departure = threading.Event()
    presence = PlantPresence(PATIENCE, lambda _: departure.set(), begun=lambda: False)
    presence.on_plant("", False)
    presence.on_disconnect()
    assert not departure.is_set()
    presence.on_plant("", True)
    assert not departure.wait(2.0 * PATIENCE)


@pytest.mark.parametrize("tokens_first", [True, False])
def test_a_program_that_loses_the_router_waits_for_the_plant(presence, tokens_first: bool) -> None:
    presence.on_router("", True)
    if tokens_first:
        presence.on_plant("", False)
    presence.on_disconnect()
    if not tokens_first:
        presence.on_plant("", False)
    presence.on_plant("", True)
    assert not presence.departure.wait(2.0 * PATIENCE)


@pytest.mark.parametrize("tokens_first", [True, False])
def test_but_not_for_ever(presence, tokens_first: bool) -> None:
    presence.on_router("", True)
    if tokens_first:
        presence.on_plant("", False)
    presence.on_disconnect()
    assert presence.departure.wait(30.0)
    assert presence.reasons == ["the plant is not back at its router"]


@pytest.mark.parametrize("router_first", [True, False])
def test_a_plant_that_went_with_a_distant_router_may_come_back(
    presence, router_first: bool
) -> None:
    presence.on_router("near", True)
    presence.on_router("far", True)
    losses = [lambda: presence.on_router("far", False), lambda: presence.on_plant("", False)]
    for lose in losses if router_first else reversed(losses):
        lose()
    presence.on_plant("", True)
    assert not presence.departure.wait(2.0 * PATIENCE)
    for lose in losses if router_first else reversed(losses):
        lose()
    assert presence.departure.wait(30.0)
    assert presence.reasons == ["the plant is not back at its router"]


def test_a_plant_that_leaves_a_router_has_left(presence) -> None:
    presence.on_router("", True)
    presence.on_plant("", False)
    assert presence.departure.wait(30.0)
    assert presence.reasons == ["the plant left"]


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
