"""Messages between server and page: contents and cursor down, a visitor's actions up."""

import json
import logging
from collections.abc import Callable

import msgspec

from phalanx_viewer.plots.content import script
from phalanx_viewer.scene.server import SceneServer

log = logging.getLogger("phalanx.viewer")

_CONNECT = """
if (!window.phalanx.connected) (() => {
  let socket = null, unsent = null;
  // A visitor who may command has the token in the address; the server asks for it under a name.
  const answer = () => {
    const token = new URLSearchParams(location.search).get("token");
    const visitor = window.phalanxVisitor;
    if (!token || !visitor || socket.readyState !== WebSocket.OPEN) return;
    window.phalanxVisitor = null;
    socket.send(JSON.stringify({ visitor, token }));
  };
  const connect = () => {
    socket = new WebSocket(location.origin.replace("http", "ws") + "/actions");
    socket.onopen = () => {
      answer();
      if (unsent) socket.send(unsent);
      unsent = "";
    };
    socket.onclose = () => setTimeout(connect, 1000);
  };
  addEventListener("phalanx-visitor", answer);
  connect();
  window.phalanx.connected = true;
  window.phalanx.act = action => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(action));
    // An action for a server that is gone is not for the one that comes after it.
    else if (unsent !== "") unsent = JSON.stringify(action);
  };
})();
"""


class Action(msgspec.Struct, frozen=True):
    """An action of a visitor; null leaves something as it is."""

    seek: float | None = None
    """[s]"""
    step: int | None = None
    """Number of recorded states to move by."""
    play: bool | None = None
    speed: float | None = None
    """Speed of a replay, in multiples of real time."""
    visitor: str = ""
    """Name under which the server asked for the token, if the visitor has one."""
    token: str = ""


class Channel:
    """Plots and timeline of every page of a server."""

    def __init__(self, server: SceneServer, act: Callable[[Action], None]) -> None:
        """act is called with each action, and must be quick."""
        self._server, self._act = server, act
        server.on_action = self._on_action
        server.run_script("script", script() + _CONNECT)

    def call(self, function: str, argument: object) -> None:
        """Call a function of the script with an argument as JSON, on every page, now or later."""
        quoted = json.dumps(msgspec.json.encode(argument).decode())  # parsed faster than a literal
        self._server.run_script(function, f"window.phalanx.{function}(JSON.parse({quoted}))")

    def _on_action(self, text: str | bytes) -> None:
        try:
            self._act(msgspec.json.decode(text, type=Action))
        except msgspec.DecodeError as error:
            log.warning("not an action: %s", error)
