"""Who is there: tokens that disappear with the session that declared them.

From those of plant and router a member knows when it has to leave.
"""

import math
import threading
import time
from collections.abc import Callable

import zenoh

from phalanx.wire.keys import PLANT, ROUTER, Keys

_BEFORE_IT_BEGINS = 3.0
"""How long a plant that is its own hub may be lost before the first sample [s]: Zenoh closes a
connection to whom it can tell nothing for a while, as when a join meets a flood."""
_MOMENT = 0.5
"""Within this after a token of the plant's is gone it is known whether the hub was lost [s]."""


def announce(session: zenoh.Session, key: str) -> zenoh.LivelinessToken:
    """Declare a liveliness token; it disappears with the session, whatever ends it."""
    return session.liveliness().declare_token(key)


def is_announced(session: zenoh.Session, token: str, timeout: float) -> bool:
    """Whether a liveliness token is there, or appears within `timeout` seconds."""
    deadline = time.monotonic() + timeout
    while (left := deadline - time.monotonic()) > 0:
        if any(reply.ok is not None for reply in session.liveliness().get(token, timeout=left)):
            return True
        time.sleep(0.05)  # nobody has announced himself yet, so the query ended at once
    return False


def watch(session: zenoh.Session, key: str, changed: Callable[[str, bool], None]) -> None:
    """Call changed(key, alive) whenever a liveliness token appears or disappears.

    It is called in Zenoh's own thread, so it must neither close nor wait.
    """

    def on_token(sample: zenoh.Sample) -> None:
        changed(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

    callback = zenoh.handlers.Callback(on_token, indirect=False)
    session.liveliness().declare_subscriber(key, callback, history=True)


def on_parting(session: zenoh.Session, parted: Callable[[], None]) -> None:
    """Call parted() when the hub is gone, at once if it is gone already.

    A liveliness token says so too, but only to who had seen it before.
    """

    def on_event(event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.DELETE:
            parted()

    session.info.declare_transport_events_listener(
        zenoh.handlers.Callback(on_event, indirect=False)
    )
    if not session.info.transports():
        parted()


class PlantPresence:
    """Whether the plant is there, as one of its clients sees it.

    Where the hub is the plant, both are lost at once. A router may be restarted: Zenoh's clients
    connect again by themselves and declare again what they had declared, and the plant is given
    time to do so; so it is before the first sample, when nothing can be missed. That the hub is
    lost is told before or after the tokens that were there go. Where a run has several routers, the
    plant is lost with the one that it is at, too, whose token goes about when the plant's does.
    """

    def __init__(
        self,
        patience: float,
        leave: Callable[[str], None],
        begun: Callable[[], bool] = lambda: True,
    ) -> None:
        """Begin without a router.

        Args:
            patience: how long a router may be lost [s].
            leave: told why; perhaps again.
            begun: whether the first sample has come.
        """
        self._patience, self._leave, self._begun = patience, leave, begun
        self._at_router, self._plant_is_there = False, True
        self._router_lost = -math.inf
        self._lock = threading.Lock()
        self._leaving: threading.Timer | None = None

    def watch(self, session: zenoh.Session, keys: Keys) -> None:
        """Begin to look; the plant is there."""
        watch(session, keys.alive(ROUTER), self.on_router)
        watch(session, keys.alive(PLANT), self.on_plant)
        on_parting(session, self.on_parting)

    def on_parting(self) -> None:
        """The connection to the hub was lost."""
        if self._at_router:
            self._await_plant()
        elif self._begun():
            self._leave("the connection to the hub was lost")
        else:
            self._put_off()
            self._leave_after(_BEFORE_IT_BEGINS, "the plant is not back")

    def on_router(self, _: str, alive: bool) -> None:
        """A router's token appeared or disappeared."""
        self._at_router = self._at_router or alive
        if not alive:
            self._router_lost = time.monotonic()
            if not self._plant_is_there:
                self._await_plant()

    def on_plant(self, _: str, alive: bool) -> None:
        """The plant's token appeared or disappeared."""
        self._plant_is_there = alive
        if alive:
            self._put_off()
        elif time.monotonic() < self._router_lost + _MOMENT:
            self._await_plant()
        elif self._at_router or not self._begun():
            self._leave_after(_MOMENT, "the plant left")
        else:
            self._leave("the plant left")

    def _await_plant(self) -> None:
        self._put_off()
        self._leave_after(self._patience, "the plant is not back at its router")

    def _leave_after(self, seconds: float, why: str) -> None:
        """Leave, unless it is put off before; what was decided before counts."""
        with self._lock:
            if self._leaving is None:
                self._leaving = threading.Timer(seconds, self._leave, [why])
                self._leaving.daemon = True
                self._leaving.start()

    def _put_off(self) -> None:
        with self._lock:
            if self._leaving is not None:
                self._leaving.cancel()
            self._leaving = None
