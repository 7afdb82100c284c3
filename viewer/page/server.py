"""The page's server: on loopback, on the port asked for, for pages of its own origin alone."""

import contextlib
import functools
import socket
from collections.abc import Iterator

import viser
import websockets.asyncio.server
from websockets.typing import Origin

DEFAULT_PORT = 8080
_TRIED = 100


class PortTakenError(OSError):
    """The port cannot be listened on; the message names it."""


def choose_port(host: str, port: int | None) -> int:
    """The port itself; or, if none was asked for, the first free one from DEFAULT_PORT on.

    Raises:
        PortTakenError: it is taken, or the host is not one of this machine's.
    """
    candidates = [port] if port is not None else range(DEFAULT_PORT, DEFAULT_PORT + _TRIED)
    problem = OSError()
    for candidate in candidates:
        try:
            with socket.create_server((host, candidate)) as probe:
                found: int = probe.getsockname()[1]
                return found
        except OSError as error:
            problem = error
    where = f"{host}:{port}" if port is not None else f"{host}, ports from {DEFAULT_PORT}"
    raise PortTakenError(f"cannot listen on {where}: {problem.strerror or problem}") from problem


class PageServer(viser.ViserServer):
    """viser without its public share link, which any visitor could ask for."""

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: a run is shown where its user wants it, and nowhere else."""
        return None


def open_page(host: str, port: int, title: str, origins: tuple[str, ...] = ()) -> PageServer:
    """Serve the page. Connections from pages of other origins are refused.

    Args:
        host: address to listen on.
        port: a free port.
        title: of the page.
        origins: further origins, such as "https://viewer.example", that may connect.
    """
    names = dict.fromkeys((host, "127.0.0.1", "localhost"))
    allowed = [*(f"http://{name}:{port}" for name in names), *origins]
    with _only_from([None, *map(Origin, allowed)]):
        server = PageServer(host=host, port=port, label=title, verbose=False)
    if server.get_port() != port:  # taken since it was chosen; viser moves on in silence
        server.stop()
        raise PortTakenError(f"cannot listen on {host}:{port}: address already in use")
    server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
    return server


@contextlib.contextmanager
def _only_from(origins: list[Origin | None]) -> Iterator[None]:
    """viser passes no origins on to websockets, which checks them; None: not from a page."""
    module = websockets.asyncio.server
    serve = module.serve
    module.serve = functools.partial(serve, origins=origins)  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        module.serve = serve  # type: ignore[misc]
