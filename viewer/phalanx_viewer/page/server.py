"""The page's address: a free port, and a server for pages of its own origin alone."""

import socket

from phalanx_viewer.scene.server import SceneServer

DEFAULT_PORT = 8080
_LAST_PORT = 65535
_TRIED = 100


class PortTakenError(OSError):
    """The port cannot be listened on; the message names it."""


def choose_port(host: str, port: int | None) -> int:
    """The port itself; or, if none was asked for, the first free one from DEFAULT_PORT on.

    Raises:
        ValueError: no port has this number.
        PortTakenError: it is taken, or the host is not one of this machine's.
    """
    if port is not None and not 1 <= port <= _LAST_PORT:
        raise ValueError(f"expected 1 to {_LAST_PORT}, got {port}")
    candidates = [port] if port is not None else range(DEFAULT_PORT, DEFAULT_PORT + _TRIED)
    problem = OSError()
    for candidate in candidates:
        try:
            with socket.create_server((host, candidate)):
                return candidate
        except OSError as error:
            problem = error
    where = f"{host}:{port}" if port is not None else f"{host}, ports from {DEFAULT_PORT}"
    raise PortTakenError(f"cannot listen on {where}: {problem.strerror or problem}") from problem


def open_page(
    host: str, port: int | None, title: str, origins: tuple[str, ...] = ()
) -> SceneServer:
    """Serve a page, to be filled before it admits visitors; pages of other origins are refused.

    Args:
        host: address to listen on.
        port: to listen on; None takes DEFAULT_PORT or the next free one.
        title: of the page.
        origins: further origins, such as "https://viewer.example", that may connect.

    Raises:
        ValueError, PortTakenError: as choose_port does.
    """
    names = dict.fromkeys((host, "127.0.0.1", "localhost"))
    for _ in range(_TRIED):
        chosen = choose_port(host, port)
        own = [f"http://{name}:{chosen}" for name in names]
        server = SceneServer(host, chosen, title, (*own, *origins))
        if server.get_port() == chosen:
            server.gui.configure_theme(
                show_logo=False, show_share_button=False, control_width="medium"
            )
            return server
        # Somebody took it since it was chosen, such as a viewer started at the same time. viser
        # moved on in silence to a port whose own pages it would refuse: choose again.
        server.stop()
    raise PortTakenError(f"cannot listen on {host}: each port was taken as soon as it was chosen")
