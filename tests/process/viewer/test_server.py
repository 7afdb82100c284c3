"""The page's server: a page of another origin cannot connect."""

from collections.abc import Iterator

import pytest
import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from phalanx.viewer.page.server import PageServer, choose_port, open_page


@pytest.fixture
def server() -> Iterator[PageServer]:
    opened = open_page("127.0.0.1", choose_port("127.0.0.1", 0), "test", ("https://ours.example",))
    yield opened
    opened.stop()


def hello(server: PageServer, origin: str | None) -> bool:
    """Whether a client that comes from a page of this origin is let in."""
    with connect(
        f"ws://127.0.0.1:{server.get_port()}",
        origin=None if origin is None else Origin(origin),
        subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
    ) as socket:
        return bool(socket.recv(timeout=10))


def test_its_own_pages_and_those_named_may_connect(server: PageServer) -> None:
    port = server.get_port()
    for origin in (f"http://127.0.0.1:{port}", f"http://localhost:{port}", "https://ours.example"):
        assert hello(server, origin)


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_a_foreign_page_is_refused(server: PageServer, origin: str) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        hello(server, origin)
