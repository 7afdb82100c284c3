"""A viser server: on a free port, for pages of given origins, without a public link."""

import asyncio
import contextlib
import io
import logging
import socket
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from concurrent.futures import Future
from http import HTTPStatus
from importlib.resources import files
from typing import Any, TypeVar

import viser
import websockets.asyncio.server
from viser._messages import RunJavascriptMessage
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.typing import Origin

T = TypeVar("T")
Handler = Callable[[ServerConnection], Awaitable[None]]

DEFAULT_PORT = 8080
_LAST_PORT = 65535
_TRIED = 100
ACTIONS = "/actions"
"""Path to which pages of the server's own origin send a visitor's actions."""


class SceneServer(viser.ViserServer):
    """viser without its public share link, which any visitor could request, and without greetings.

    Other programs read the command's standard output.

    Once visitors are admitted, everything is sent to them from the server's own thread: from
    another one viser sometimes fails with "deque mutated during iteration".
    """

    def __init__(self, host: str, port: int, title: str, origins: tuple[str, ...] = ()) -> None:
        """Listen; visitors wait until admit() is called.

        port: or the next free one, see get_port(); 0: any free one. origins: origins such as
        "https://viewer.example" whose pages may connect; by default none. A program that is no
        browser sends no origin, and may connect.
        """
        self.on_action: Callable[[str | bytes], None] = lambda _: None
        """Called with each message to ACTIONS, in the server's thread."""
        self._complete: Future[None] = Future()
        with serving(self._let_in, origins), contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host=host, port=port, label=title, verbose=False)
        self.run_script(
            "frames", files("phalanx_viewer.scene").joinpath("viser_frames.js").read_text()
        )

    def admit(self) -> None:
        """Admit visitors: the page is complete."""
        self._complete.set_result(None)

    def run(self, act: Callable[[], T]) -> T:
        """Run a function in the server's thread, and return its result; call from another one."""

        async def called() -> T:
            return act()

        return asyncio.run_coroutine_threadsafe(called(), self.get_event_loop()).result()

    def run_script(self, name: str, source: str, client: viser.ClientHandle | None = None) -> None:
        """Run JavaScript on one client's page; or on every page, and on later ones, in order.

        Later ones run the last script of each name.
        """
        to = self._websock_server if client is None else client._websock_connection
        to.queue_message(named_script(name, source))

    def stop(self) -> None:
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Return None: a run is shown nowhere but where its user serves it."""
        return None

    async def _let_in(self, handler: Handler, connection: ServerConnection) -> None:
        await asyncio.shield(asyncio.wrap_future(self._complete))
        if connection.request is None or connection.request.path != ACTIONS:
            await handler(connection)
            return
        async for message in connection:
            self.on_action(message)


@contextlib.contextmanager
def serving(
    let_in: Callable[[Handler, ServerConnection], Awaitable[None]], origins: tuple[str, ...]
) -> Iterator[None]:
    """Make servers that are started in the block check origins, and let_in handle connections.

    A browser lets any page that its user visits connect to a port of the user's machine, and only
    sends the page's origin. Without the check a foreign page could watch and command a run.
    """
    # viser 1.1 calls serve() in a thread of its own, without `origins` and with one handler for all
    # paths. Its constructor returns when that thread listens: the block lasts long enough.
    # Upstream has no issue yet. It would say: "ViserServer should take `origins` for
    # websockets.serve(): without it any page that a user visits can connect to the server on his
    # machine and command it."
    websockets_log = logging.getLogger("websockets.server")
    # It logs a traceback for each connection that ends before its handshake.
    websockets_log.addFilter(lambda record: record.msg != "opening handshake failed")
    module = websockets.asyncio.server
    serve, allowed = module.serve, [None, *map(Origin, origins)]

    def checked(handler: Handler, *arguments: Any, **options: Any) -> Any:
        def answer(connection: ServerConnection, request: Request) -> Any:
            # viser's page takes "/#t=1" for the address of its server, but not "/?page#t=1". A
            # browser takes what is behind the # along. Some clients take "/?" for "/", for ever.
            if request.path == "/" and "Upgrade" not in request.headers:
                headers = Headers({"Location": "/?page", "Content-Length": "0"})
                return Response(HTTPStatus.FOUND, "Found", headers)
            return options["process_request"](connection, request)

        async def handle(connection: ServerConnection) -> None:
            await let_in(handler, connection)

        return serve(handle, *arguments, origins=allowed, **options | {"process_request": answer})

    module.serve = checked  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        module.serve = serve  # type: ignore[misc]


def named_script(name: str, source: str) -> RunJavascriptMessage:
    """Make a script that replaces the last one of its name for later visitors."""
    # viser 1.1 keeps every script, and every later visitor runs it again. Upstream has no issue
    # yet. It would say: "RunJavascriptMessage should take a key by which a later script replaces
    # an earlier one."
    message = RunJavascriptMessage(source)
    message.redundancy_key = lambda: f"phalanx-{name}"  # type: ignore[method-assign]
    return message


Callback = Callable[[Any], Coroutine[Any, Any, None]]


def in_loop(act: Callable[[Any], None]) -> Callback:
    """Make a callback async: viser runs others outside the server's thread."""

    async def called(event: Any) -> None:
        act(event)

    return called


class PortTakenError(OSError):
    """A port cannot be listened on; the message names it."""


def choose_port(host: str, port: int | None) -> int:
    """Return the port, if it is free; for None the first free one from DEFAULT_PORT on.

    Raises ValueError if no port has this number, PortTakenError if it is taken, or the host is not
    one of this machine's.
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

    Arguments as of SceneServer, but `origins` are further ones, and port None takes DEFAULT_PORT or
    the next free one. Raises ValueError, PortTakenError.
    """
    names = dict.fromkeys((host, "127.0.0.1", "localhost"))
    for _ in range(_TRIED):
        chosen = choose_port(host, port)
        local = [f"http://{name}:{chosen}" for name in names]
        server = SceneServer(host, chosen, title, (*local, *origins))
        if server.get_port() == chosen:
            server.gui.configure_theme(
                show_logo=False, show_share_button=False, control_width="medium"
            )
            return server
        # Another program took it since it was chosen, such as a viewer started at the same time.
        # viser silently took another port, whose own pages it would refuse: choose again.
        server.stop()
    raise PortTakenError(f"cannot listen on {host}: each port was taken as soon as it was chosen")
