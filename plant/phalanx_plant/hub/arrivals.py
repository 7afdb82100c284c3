"""What has come from agents and waits for the plant's own thread: never more than it can hold."""

import queue
import threading
from collections.abc import Callable, Iterable

from phalanx.wire.messages import MAX_BYTES
from phalanx.wire.seal import Malformed, Refusals

_MOST = 256
"""Payloads that wait under one key expression; an agent has a few at most on their way."""

RequireAwaited = Callable[[str, bytes], None]


class Arrivals:
    """Payloads and tokens in the order in which they came.

    Zenoh's threads only put here; everything is opened and believed in the plant's own. But where
    more waits than an agent has to say, it is held against what is awaited before it may wait, from
    then on: a flood in an agent's name does not drown its answer.
    """

    def __init__(
        self, keys: Iterable[str], refusals: Refusals, require_awaited: RequireAwaited
    ) -> None:
        """Begin with nothing.

        Args:
            keys: under which payloads may come; all others are refused.
            refusals: where to count what is.
            require_awaited: raises Malformed for a payload that is no answer awaited under a key.
        """
        self._refusals, self._require_awaited = refusals, require_awaited
        self._flooded: set[str] = set()
        # Not queue.SimpleQueue: up to Python 3.12 its get waits for ever if a signal, or a wake-up
        # for nothing, finds the timeout just over.
        self._arrived: queue.Queue[tuple[str, bytes | bool]] = queue.Queue()
        self._waiting = dict.fromkeys(keys, 0)
        self._lock = threading.Lock()

    def put_payload(self, key: str, payload: bytes) -> None:
        """A payload came."""
        reason = self._reason_against(key, payload)
        if reason is not None:
            self._refusals.add(key, reason)
            return
        with self._lock:
            self._waiting[key] += 1
        self._arrived.put((key, payload))

    def put_token(self, key: str, alive: bool) -> None:
        """A liveliness token appeared or disappeared."""
        self._arrived.put((key, alive))

    @property
    def waiting(self) -> int:
        """How many there are."""
        return self._arrived.qsize()

    def get(self, timeout: float) -> tuple[str, bytes | bool]:
        """The next payload, or whether a token is there. Raises queue.Empty after timeout [s]."""
        key, content = self._arrived.get(timeout=timeout)
        if key in self._waiting:
            with self._lock:
                self._waiting[key] -= 1
        return key, content

    def _reason_against(self, key: str, payload: bytes) -> str | None:
        if key not in self._waiting:
            return "unknown sender"
        if len(payload) > MAX_BYTES:
            return "oversized"
        if self._waiting[key] >= _MOST:
            self._flooded.add(key)
        if key not in self._flooded:
            return None
        try:
            self._require_awaited(key, payload)
        except Malformed as reason:
            return str(reason)
        # Those that waited already when it began to be a flood leave as much room again.
        return "too many" if self._waiting[key] >= 2 * _MOST else None
