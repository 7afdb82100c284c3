"""Liveliness: tokens that disappear with the session that declared them.

From the tokens of plant and router a program knows when it has to leave the run.
"""

import math
import threading
import time
from collections.abc import Callable

import zenoh

from phalanx.messages.keys import PLANT, ROUTER, Keys

_RECONNECT_TIME = 3.0
"""Time for a plant that is its own hub to come back before the first sample [s]: Zenoh closes a
connection that takes nothing for a while, as when a join meets a flood."""
_MOMENT = 0.5
"""Longest time between the loss of the plant's token and that of the hub, if both are lost [s]."""


def announce(session: zenoh.Session, key: str) -> zenoh.LivelinessToken:
    """Declare a liveliness token; it disappears with the session, for any reason."""
    return session.liveliness().declare_token(key)


def is_announced(session: zenoh.Session, token: str, timeout: float) -> bool:
    """Return whether a liveliness token is there, or appears within `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while (remaining := deadline - time.monotonic()) > 0:
        if any(
            reply.ok is not None for reply in session.liveliness().get(token, timeout=remaining)
        ):
            return True
        time.sleep(0.05)  # without any token the query ends at once
    return False


def watch(session: zenoh.Session, key: str, changed: Callable[[str, bool], None]) -> None:
    """Call changed(key, alive) whenever a liveliness token appears or disappears.

    It is called in Zenoh's own thread, so it must neither close the session nor wait.
    """

    def on_token(sample: zenoh.Sample) -> None:
        changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    callback = zenoh.handlers.Callback(on_token, indirect=False)
    session.liveliness().declare_subscriber(key, callback, history=True)


def on_disconnect(session: zenoh.Session, disconnected: Callable[[], None]) -> None:
    """Call disconnected() when the connection to the hub is lost, at once if it is lost already.

    A program that never received the hub's token would not get its removal.
    """

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE:
            disconnected()

    session.info.declare_transport_events_listener(
        zenoh.handlers.Callback(on_event, indirect=False)
    )
    if not session.info.transports():
        disconnected()


class PlantPresence:
    """Presence of the plant, as one of its clients sees it.

    If the plant is the hub, both are lost at once. A router may be restarted: Zenoh's clients then
    reconnect and declare their tokens again, and the plant gets time to do so. It also gets time
    before the first sample, when nothing can be missed. The loss of the hub may be reported before
    or after the loss of its tokens. If a run has several routers, the plant is also lost with its
    own router, whose token disappears at about the same time as the plant's.
    """

    def __init__(
        self,
        patience: float,
        leave: Callable[[str], None],
        begun: Callable[[], bool] = lambda: True,
    ) -> None:
        """Assume a plant and no router.

        Args:
            patience: time for a router to come back [s].
            leave: called with the reason, perhaps more than once.
            begun: returns whether the first sample has come.
        """
        self._patience, self._leave, self._begun = patience, leave, begun
        self._at_router, self._plant_is_there = False, True
        self._router_lost = -math.inf
        self._lock = threading.Lock()
        self._leaving: threading.Timer | None = None

    def watch(self, session: zenoh.Session, keys: Keys) -> None:
        """Watch tokens and connection of a session from now on."""
        watch(session, keys.alive(ROUTER), self.on_router)
        watch(session, keys.alive(PLANT), self.on_plant)
        on_disconnect(session, self.on_disconnect)

    def on_disconnect(self) -> None:
        """Handle the loss of the connection to the hub."""
        if self._at_router:
            self._await_plant()
        elif self._begun():
            self._leave("the connection to the hub was lost")
        else:
            self._stay()
            self._leave_after(_RECONNECT_TIME, "the plant is not back")

    def on_router(self, _: str, alive: bool) -> None:
        """Handle a router's token that appeared or disappeared."""
        self._at_router = self._at_router or alive
        if not alive:
            self._router_lost = time.monotonic()
            if not self._plant_is_there:
                self._await_plant()

    def on_plant(self, _: str, alive: bool) -> None:
        """Handle the plant's token, which appeared or disappeared."""
        self._plant_is_there = alive
        if alive:
            self._stay()
        elif time.monotonic() < self._router_lost + _MOMENT:
            self._await_plant()
        elif self._at_router or not self._begun():
            self._leave_after(_MOMENT, "the plant left")
        else:
            self._leave("the plant left")

    def _await_plant(self) -> None:
        self._stay()
        self._leave_after(self._patience, "the plant is not back at its router")

    def _leave_after(self, seconds: float, why: str) -> None:
        """Leave after a time, unless another time was set before or _stay is called."""
        with self._lock:
            if self._leaving is None:
                self._leaving = threading.Timer(seconds, self._leave, [why])
                self._leaving.daemon = True
                self._leaving.start()

    def _stay(self) -> None:
        with self._lock:
            if self._leaving is not None:
                self._leaving.cancel()
            self._leaving = None
