"""The page's server: its port, and that a page of another origin cannot connect."""

import socket
from collections.abc import Iterator

import pytest
import viser
from phalanx_viewer.scene.server import PortTakenError, SceneServer, choose_port, open_page
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol


@pytest.fixture
def server() -> Iterator[SceneServer]:
    opened = open_page("127.0.0.1", None, "test", ("https://ours.example",))
    opened.admit()
    yield opened
    opened.stop()


def hello(server: SceneServer, origin: str | None) -> bool:
    """True if a client that comes from a page of this origin is admitted."""
    with connect(
        f"ws://127.0.0.1:{server.get_port()}",
        origin=None if origin is None else Origin(origin),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
    ) as socket:
        return bool(socket.recv(timeout=60))


def test_its_own_pages_and_those_named_may_connect(server: SceneServer) -> None:
    port = server.get_port()
    for origin in (f"http://127.0.0.1:{port}", f"http://localhost:{port}", "https://ours.example"):
        assert hello(server, origin)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_foreign_page_is_refused(server: SceneServer, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        hello(server, origin)


@pytest.mark.parametrize("opening", [b"", b"GET / HTTP/1.1\r\n", b"\x16\x03\x01 nonsense\r\n\r\n"])
def test_a_connection_that_ends_before_its_handshake_leaves_no_traceback(
    server: SceneServer, caplog: pytest.LogCaptureFixture, opening: bytes
) -> None:
    with socket.create_connection(("127.0.0.1", server.get_port())) as visitor:
        visitor.sendall(opening)
        visitor.shutdown(socket.SHUT_WR)
        while visitor.recv(1024):
            pass
    assert hello(server, None)
    assert not caplog.records


def test_two_pages_without_a_port_asked_for_get_one_each(server: SceneServer) -> None:
    other = open_page("127.0.0.1", None, "other")
    other.stop()
    assert other.get_port() != server.get_port()


def test_a_port_that_is_taken_is_refused(server: SceneServer) -> None:
    port = server.get_port()
    with pytest.raises(PortTakenError, match=f"127.0.0.1:{port}"):
        open_page("127.0.0.1", port, "other")


@pytest.mark.parametrize("port", [-1, 0, 65536, 99999])
def test_a_number_that_no_port_has_is_refused_with_the_range(port: int) -> None:
    with pytest.raises(ValueError, match=f"expected 1 to 65535, got {port}"):
        choose_port("127.0.0.1", port)
