"""The plant's session: all that it puts on the wire, and what has come from there and waits."""

import queue
import threading
from collections.abc import Callable, Iterable

from phalanx.identities.access import admission
from phalanx.scenario.load import to_json
from phalanx.swarm.swarm import Swarm
from phalanx.wire import liveliness, pubsub
from phalanx.wire.keys import PLANT, ROUTER
from phalanx.wire.membership import Membership
from phalanx.wire.messages import MAX_BYTES, Place, PlaceRequest, Setup
from phalanx.wire.pubsub import Copies, Delivery, SealedPublisher
from phalanx.wire.seal import Malformed, Refusals
from phalanx.wire.session import Session, open_hub, open_member

_MOST = 256
"""Payloads that wait under one key expression; an agent has a few at most on their way."""

RequireAwaited = Callable[[str, bytes], None]


class PlantSession:
    """Puts, queries and tokens of one run; it believes nothing of what it receives."""

    def __init__(self, swarm: Swarm, membership: Membership, at_router: bool) -> None:
        """Listen on the membership's endpoint, or meet the others at the router that does.

        Raises HubError.
        """
        keys = self._keys = membership.keys
        sealer = self._sealer = membership.sealer
        self._scenario = swarm.scenario
        session = self._session = _open(swarm, membership, at_router)
        copies = Copies(session, keys, keys.sample("*"))
        self.samples = [
            SealedPublisher(session, sealer, keys.sample(name), Delivery.URGENT, copies)
            for name in swarm.names
        ]
        """Of each agent."""
        self.status = SealedPublisher(session, sealer, keys.status, Delivery.NOTICE)
        self.verdict = SealedPublisher(session, sealer, keys.verdict, Delivery.NOTICE)
        self.frames = SealedPublisher(session, sealer, keys.frames, Delivery.VIEW)

    def close(self) -> None:
        """Leave the run, which ends it for all others."""
        self._session.close()  # type: ignore[no-untyped-call]

    def receive(self, arrivals: "Arrivals") -> None:
        """Put what agents send, and their tokens, there."""
        keys = self._keys
        for every in (keys.actuation("*"), keys.telemetry("*")):
            pubsub.subscribe(self._session, every, arrivals.put_payload)
        liveliness.watch(self._session, keys.alive("*"), arrivals.put_token)

    def give_places(self, place: Callable[[PlaceRequest], Place], refusals: Refusals) -> None:
        """Answer claimants in a thread of Zenoh's."""
        key = self._keys.place

        def answer(question: bytes) -> bytes | None:
            try:
                request = self._sealer.open(key, question, PlaceRequest)
            except Malformed as reason:
                refusals.add(key, reason)
                return None
            return self._sealer.seal(key, place(request))

        pubsub.answer_each(self._session, key, answer)

    def announce(self, digest: str) -> None:
        """Say that the plant is there, with a scenario of this digest."""
        self._token = liveliness.announce(self._session, self._keys.alive(PLANT, digest))

    def answer_viewers(self, commandable: bool) -> None:
        """Answer viewers that ask for the scenario."""
        setup = Setup(scenario=to_json(self._scenario).encode(), commandable=commandable)
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
