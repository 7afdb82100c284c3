"""When a member has to leave: the plant left, or the hub is lost and does not come back."""

import threading
from collections.abc import Callable

from phalanx.wire import session as wire
from phalanx.wire.keys import PLANT, ROUTER, Keys

_MOMENT = 0.5
"""Within this after a token of the plant's is gone it is known whether the hub was lost [s]."""


class PlantPresence:
    """Whether the plant is there, as one of its clients sees it.

    Where the hub is the plant, both are lost at once. A router may be restarted: Zenoh's clients
    connect again by themselves and declare again what they had declared, and the plant is given
    time to do so. That the hub is lost is told before or after the tokens that were there go.
    """

    def __init__(self, patience: float, leave: Callable[[str], None]) -> None:
        """patience: how long a router may be lost [s]. leave is told why; perhaps again."""
        self._patience, self._leave = patience, leave
        self._at_router = False
        self._lock = threading.Lock()
        self._leaving: threading.Timer | None = None

    def watch(self, session: wire.Session, keys: Keys) -> None:
        """Begin to look; the plant is there."""
        wire.watch(session, keys.alive(ROUTER), self.on_router)
        wire.watch(session, keys.alive(PLANT), self.on_plant)
        wire.on_parting(session, self.on_parting)

    def on_parting(self) -> None:
        """The connection to the hub was lost."""
        if not self._at_router:
            self._leave("the connection to the hub was lost")
            return
        self._put_off()
        self._leave_after(self._patience, "the plant is not back at its router")

    def on_router(self, _: str, alive: bool) -> None:
        """A router's token appeared or disappeared."""
        self._at_router = self._at_router or alive

    def on_plant(self, _: str, alive: bool) -> None:
        """The plant's token appeared or disappeared."""
        if alive:
            self._put_off()
        elif self._at_router:
            self._leave_after(_MOMENT, "the plant left")
        else:
            self._leave("the plant left")

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
