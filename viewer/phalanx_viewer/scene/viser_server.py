"""Add to viser's server what it has no option for: check origins, and replace scripts by name.

viser 1.1 calls websockets' serve() in a thread of its own, without `origins` and with one handler
for all paths. It keeps every script, and every later visitor runs it again. websockets logs a
traceback for each connection that ends before its handshake.

Upstream has no issue yet. Its text: "ViserServer should take `origins` for websockets.serve():
without it any page that a user visits can connect to the server on his machine and command it.
RunJavascriptMessage should take a key by which a later script replaces an earlier one."
"""

import contextlib
import logging
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import websockets.asyncio.server
from viser._messages import RunJavascriptMessage
from websockets.asyncio.server import ServerConnection
from websockets.typing import Origin

Handler = Callable[[ServerConnection], Awaitable[None]]


@contextlib.contextmanager
def serving(
    let_in: Callable[[Handler, ServerConnection], Awaitable[None]], origins: tuple[str, ...]
) -> Iterator[None]:
    """Make servers that are started in the block check origins, and let_in handle connections.

    A browser lets any page that its user visits connect to a port of the user's machine, and only
    sends the page's origin. Without the check a foreign page could watch and command a run.
    """
    # viser's constructor returns when its thread listens: the block lasts long enough.
    websockets_log = logging.getLogger("websockets.server")
    websockets_log.addFilter(lambda record: record.msg != "opening handshake failed")
    module = websockets.asyncio.server
    serve, allowed = module.serve, [None, *map(Origin, origins)]

    def checked(handler: Handler, *arguments: Any, **options: Any) -> Any:
        async def handle(connection: ServerConnection) -> None:
            await let_in(handler, connection)

        return serve(handle, *arguments, origins=allowed, **options)

    module.serve = checked  # type: ignore[assignment, misc]
    try:
        yield
    finally:
        module.serve = serve  # type: ignore[misc]


def named_script(name: str, source: str) -> RunJavascriptMessage:
    """Make a script that replaces the last one of its name for later visitors."""
    message = RunJavascriptMessage(source)
    message.redundancy_key = lambda: f"phalanx-{name}"  # type: ignore[method-assign]
    return message
