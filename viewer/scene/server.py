"""A viser server to draw on: for pages of given origins alone, and without a public link."""

import contextlib
import functools
import io
from collections.abc import Iterator

import viser
import websockets.asyncio.server
from websockets.typing import Origin


class SceneServer(viser.ViserServer):
    """viser without its public share link, which any visitor could ask for, and without greetings.

    Standard output is for what the command has to say; other programs read it.
    """

    def __init__(self, host: str, port: int, title: str) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, label=title, verbose=False)

    def stop(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: a run is shown where its user wants it, and nowhere else."""
        return None


def serve_scene(host: str, port: int, title: str, origins: tuple[str, ...] = ()) -> SceneServer:
    """Start a server.

    Args:
        host: address to listen on.
        port: to listen on, or the next free one: ask get_port(). 0: any free one.
        title: of the page.
        origins: whose pages may connect, such as "https://viewer.example"; by default none. A
            program that is no browser says no origin, and may connect.
    """
    with _only_from([None, *map(Origin, origins)]):
        return SceneServer(host, port, title)


@contextlib.contextmanager
def _only_from(origins: list[Origin | None]) -> Iterator[None]:
    """Let servers that are started in the block check the origin of a connection.

    A browser lets any page that its user visits connect to a port of his machine, and only tells
    where the page came from: without the check, a foreign page could watch a run and command it.
    """
    # viser has no option for it. It calls websockets' serve(), which checks origins, in a thread of
    # its own, and its constructor returns when that thread listens: the block lasts long enough.
    module = websockets.asyncio.server
    serve = module.serve
    module.serve = functools.partial(serve, origins=origins)  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        module.serve = serve  # type: ignore[misc]
