"""The plant's Zenoh session, and the queue of messages that it received."""

import queue
import threading
from collections.abc import Iterable

from phalanx.messages.admission import admission
from phalanx.messages.frames import Setup
from phalanx.messages.keys import PLANT, ROUTER
from phalanx.messages.kinds import MAX_BYTES
from phalanx.messages.membership import Membership
from phalanx.messages.seal import Malformed, Refusals
from phalanx.scenario.model import to_json
from phalanx.swarm.swarm import Swarm
from phalanx.wire import liveliness, pubsub
from phalanx.wire.pubsub import Delivery, SealedPublisher
from phalanx.wire.session import Session, open_hub, open_member

_MOST = 256
"""Most queued payloads of one key; an honest agent has a few at most in flight."""


class PlantSession:
    """Publishers, subscribers, queries and tokens of one run; it checks nothing it receives."""

    def __init__(self, swarm: Swarm, membership: Membership, at_router: bool) -> None:
        """Listen on the membership's endpoint, or connect to the router that does.

        Raises HubError.
        """
        keys = self._keys = membership.keys
        sealer = self._sealer = membership.sealer
        self._scenario = swarm.scenario
        session = self._session = _open(swarm, membership, at_router)
        self.samples = [
            SealedPublisher(session, sealer, keys.sample(name), Delivery.URGENT)
            for name in swarm.names
        ]
        """For each agent."""
        self.status = SealedPublisher(session, sealer, keys.status, Delivery.NOTICE)
        self.verdict = SealedPublisher(session, sealer, keys.verdict, Delivery.NOTICE)
        self.frames = SealedPublisher(session, sealer, keys.frames, Delivery.VIEW)

    def close(self) -> None:
        """Close the session, which ends the run for all others."""
        self._session.close()  # type: ignore[no-untyped-call]

    def receive(self, incoming: "IncomingQueue") -> None:
        """Put agents' messages and tokens into this queue."""
        keys = self._keys
        for every in (keys.actuation("*"), keys.telemetry("*")):
            pubsub.subscribe(self._session, every, incoming.put_payload)
        liveliness.watch(self._session, keys.alive("*"), incoming.put_token)

    def announce(self, digest: str) -> None:
        """Declare the plant's token, with its scenario's digest."""
        self._token = liveliness.announce(self._session, self._keys.alive(PLANT, digest))

    def answer_viewers(self, commandable: bool, real_time: bool) -> None:
        """Answer queries for the scenario."""
        scenario = to_json(self._scenario).encode()
        setup = Setup(scenario=scenario, commandable=commandable, real_time=real_time)
        key = self._keys.scenario
        pubsub.answer(self._session, key, self._sealer.seal(key, setup))

    def listen_for_commands(self, deliver: pubsub.Deliver) -> None:
        """Deliver commands in a thread of Zenoh's."""
        pubsub.subscribe(self._session, self._keys.command, deliver)


def _open(swarm: Swarm, membership: Membership, at_router: bool) -> Session:
    if not at_router:
        return open_hub(membership.endpoint, admission(swarm, membership))
    router = membership.keys.alive(ROUTER)
    return open_member(membership.endpoint, router, membership.timeout, membership.credentials)


class IncomingQueue:
    """Payloads and tokens in the order of their arrival.

    Zenoh's threads put them here, and the plant's own thread opens and checks them. Once too many
    payloads of a key are queued, its payloads are checked before they are queued: a flood in an
    agent's name does not block its answer.
    """

    def __init__(
        self, keys: Iterable[str], refusals: Refusals, require_pending: pubsub.Deliver
    ) -> None:
        """Begin with nothing.

        Args:
            keys: of payloads to accept; all others are refused.
            refusals: counts them.
            require_pending: raises Malformed unless a payload is a pending answer of a key.
        """
        self._refusals, self._require_pending = refusals, require_pending
        self._flooded: set[str] = set()
        # Not queue.SimpleQueue: up to Python 3.12 its get waits for ever if a signal, or a spurious
        # wake-up, arrives just after the timeout.
        self._arrived: queue.Queue[tuple[str, bytes | bool]] = queue.Queue()
        self._waiting = dict.fromkeys(keys, 0)
        self._lock = threading.Lock()

    def put_payload(self, key: str, payload: bytes) -> None:
        """Queue or refuse a payload."""
        reason = self._reason_against(key, payload)
        if reason is not None:
            self._refusals.add(key, reason)
            return
        with self._lock:
            self._waiting[key] += 1
        self._arrived.put((key, payload))

    def put_token(self, key: str, alive: bool) -> None:
        """Queue the appearance or disappearance of a liveliness token."""
        self._arrived.put((key, alive))

    @property
    def waiting(self) -> int:
        """Number of queued payloads and tokens."""
        return self._arrived.qsize()

    def get(self, timeout: float) -> tuple[str, bytes | bool]:
        """The next payload, or whether a token exists. Raises queue.Empty after timeout [s]."""
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
            self._require_pending(key, payload)
        except Malformed as reason:
            return str(reason)
        # Payloads queued before the flood was noticed leave as much room again.
        return "too many" if self._waiting[key] >= 2 * _MOST else None
