"""A viser server to draw on: for pages of given origins alone, and without a public link."""

import contextlib
import io
from collections.abc import Callable, Iterator
from typing import Any

import viser
import websockets.asyncio.server
from viser._messages import RunJavascriptMessage
from websockets.asyncio.server import ServerConnection
from websockets.typing import Origin

ACTIONS = "/actions"
"""Where pages of the server's own origin send what a visitor does."""


class SceneServer(viser.ViserServer):
    """viser without its public share link, which any visitor could ask for, and without greetings.

    Standard output is for what the command has to say; other programs read it.
    """

    def __init__(self, host: str, port: int, title: str) -> None:
        self.on_action: Callable[[str | bytes], None] = lambda _: None
        """Called with each message to ACTIONS, in a thread of viser's."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, label=title, verbose=False)

    def run_script(self, name: str, source: str) -> None:
        """Run JavaScript on every page, and on later ones the last of each name, in order."""
        message = RunJavascriptMessage(source)
        # By itself viser would keep every script for pages to come.
        message.redundancy_key = lambda: f"phalanx-{name}"  # type: ignore[method-assign]
        self._websock_server.queue_message(message)

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
    with _serving(origins) as actions:
        server = SceneServer(host, port, title)
        actions.append(lambda text: server.on_action(text))
        return server


@contextlib.contextmanager
def _serving(origins: tuple[str, ...]) -> Iterator[list[Callable[[str | bytes], None]]]:
    """Let servers that are started in the block check origins, and hand actions on.

    A browser lets any page that its user visits connect to a port of his machine, and only tells
    where the page came from: without the check, a foreign page could watch a run and command it.
    """
    # viser has no option for either. It calls websockets' serve(), which checks origins, in a
    # thread of its own, and its constructor returns when that thread listens: the block lasts long
    # enough.
    module, actions = websockets.asyncio.server, list[Callable[[str | bytes], None]]()
    serve, allowed = module.serve, [None, *map(Origin, origins)]

    def checked(handler: Any, *arguments: Any, **options: Any) -> Any:
        async def handle(connection: ServerConnection) -> None:
            if connection.request is None or connection.request.path != ACTIONS:
                await handler(connection)
                return
            async for message in connection:
                for act in actions:
                    act(message)

        return serve(handle, *arguments, origins=allowed, **options)

    module.serve = checked  # type: ignore[assignment, misc]
    try:
        yield actions
    finally:
        module.serve = serve  # type: ignore[misc]
