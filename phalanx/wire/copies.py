"""Copies of what steers a run, for those who look on: a reader that stops holds up nobody.

Samples, actuations, broadcasts and telemetry are put so that none is lost, and so who gets them can
make their senders wait. Viewers get copies instead, which are dropped where they are not taken.
"""

from functools import cache

import zenoh

from phalanx.wire.keys import Keys
from phalanx.wire.pubsub import Addressed, has_listener, view_publisher
from phalanx.wire.session import Session


class Copies:
    """What one program puts, put once more while somebody looks on."""

    def __init__(self, session: Session, keys: Keys, every: str) -> None:
        """every: a key expression that includes all of which there may be copies."""
        self._copy = cache(keys.copy)
        self._addressed = Addressed(session, droppable=True, priority=zenoh.Priority.DATA_LOW)
        self._readers = view_publisher(session, keys.copy(every))
        self._wanted = False
        on_match = zenoh.handlers.Callback(self._on_match, indirect=False)
        self._readers.declare_matching_listener(on_match)

    def look_for_readers(self) -> None:
        """Find those who came before, of whom nothing is told."""
        self._wanted = has_listener(self._readers)

    def put(self, key: str, payload: bytes) -> None:
        """Put a copy of what was put on a key, if anybody looks on."""
        if self._wanted:
            self._addressed.put(self._copy(key), payload)

    def _on_match(self, status: zenoh.MatchingStatus) -> None:
        self._wanted = status.matching
