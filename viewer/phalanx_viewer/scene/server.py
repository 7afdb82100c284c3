"""A viser server to draw on: for pages of given origins alone, and without a public link."""

import asyncio
import contextlib
import io
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any, TypeVar

import viser
from websockets.asyncio.server import ServerConnection

from phalanx.compat.viser_server import Handler, named_script, serving

T = TypeVar("T")

ACTIONS = "/actions"
"""Where pages of the server's own origin send what a visitor does."""


class SceneServer(viser.ViserServer):
    """viser without its public share link, which any visitor could ask for, and without greetings.

    Standard output is for what the command has to say; other programs read it.

    Once visitors are admitted, everything that is sent to them is sent from the server's own
    thread: from another one viser would, now and then, die of "deque mutated during iteration".
    """

    def __init__(self, host: str, port: int, title: str, origins: tuple[str, ...] = ()) -> None:
        """Listen; nobody is let in before admit() is called.

        Args:
            host: address to listen on.
            port: to listen on, or the next free one: ask get_port(). 0: any free one.
            title: of the page.
            origins: whose pages may connect, such as "https://viewer.example"; by default none. A
                program that is no browser says no origin, and may connect.
        """
        self.on_action: Callable[[str | bytes], None] = lambda _: None
        """Called with each message to ACTIONS, in the server's thread."""
        self._complete: Future[None] = Future()
        with serving(self._let_in, origins), contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, label=title, verbose=False)

    def admit(self) -> None:
        """Let visitors in: the page is complete."""
        self._complete.set_result(None)

    def run(self, act: Callable[[], T]) -> T:
        """Run a function in the server's thread; what it returns. To be called from another one."""

        async def called() -> T:
            return act()

        return asyncio.run_coroutine_threadsafe(called(), self.get_event_loop()).result()

    def run_script(self, name: str, source: str, client: viser.ClientHandle | None = None) -> None:
        """Run JavaScript on one client's page; or on every page, and on later ones, in order.

        Those get the last script of each name.
        """
        to = self._websock_server if client is None else client._websock_connection
        to.queue_message(named_script(name, source))

    def stop(self) -> None:
        """Stop serving."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Refuse: a run is shown where its user wants it, and nowhere else."""
        return None

    async def _let_in(self, handler: Handler, connection: ServerConnection) -> None:
        await asyncio.shield(asyncio.wrap_future(self._complete))
        if connection.request is None or connection.request.path != ACTIONS:
            await handler(connection)
            return
        async for message in connection:
            self.on_action(message)


def in_loop(act: Callable[[Any], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
    """A callback that viser runs in the server's thread; those that are not async it does not."""

    async def called(event: Any) -> None:
        act(event)

    return called
