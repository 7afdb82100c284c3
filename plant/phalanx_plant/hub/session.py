"""The plant's session: all that it puts on the wire, and where what comes from there is put."""

from collections.abc import Callable

from phalanx.identities.access import admission
from phalanx.scenario.load import to_json
from phalanx.swarm.swarm import Swarm
from phalanx.wire import liveliness, pubsub
from phalanx.wire.keys import PLANT, ROUTER
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Ended, Message, Place, PlaceRequest, Sample, Setup, Status
from phalanx.wire.seal import Malformed, Refusals, Sealer
from phalanx.wire.session import Session, open_hub, open_member
from phalanx_plant.hub.arrivals import Arrivals


class PlantSession:
    """Puts, queries and tokens of one run; it believes nothing of what it receives."""

    def __init__(self, swarm: Swarm, membership: Membership, at_router: bool) -> None:
        """Listen on the membership's endpoint, or meet the others at the router that does.

        Raises HubError.
        """
        keys = self._keys = membership.keys
        self._sealer, self._scenario = membership.sealer, swarm.scenario
        self._session = _open(swarm, membership, at_router)
        self._sample_keys = [keys.sample(name) for name in swarm.names]
        self._samples = [
            pubsub.publisher(self._session, key, pubsub.Delivery.URGENT)
            for key in self._sample_keys
        ]
        self._copies = pubsub.Copies(self._session, keys, keys.sample("*"))
        self._status = pubsub.publisher(self._session, keys.status, pubsub.Delivery.NOTICE)
        self._verdict = pubsub.publisher(self._session, keys.verdict, pubsub.Delivery.NOTICE)

    def close(self) -> None:
        """Leave the run, which ends it for all others."""
        self._session.close()  # type: ignore[no-untyped-call]

    def receive(self, arrivals: Arrivals) -> None:
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

    def is_heard(self, i: int) -> bool:
        """Whether agent i gets its samples: at a router that may be known later."""
        return pubsub.has_listener(self._samples[i])

    def wait_until_heard(self, i: int, timeout: float) -> None:
        """Return when agent i gets its samples."""
        pubsub.wait_for_listener(self._samples[i], timeout)

    def put_sample(self, i: int, sample: Sample) -> None:
        """Hand agent i its sample."""
        key = self._sample_keys[i]
        payload = self._sealer.seal(key, sample)
        self._samples[i].put(payload)
        self._copies.put(key, payload)

    def put_status(self, message: Status) -> None:
        """Publish how far the run is."""
        self._put(self._status, message)

    def put_verdict(self, message: Ended) -> None:
        """Publish how the run ended."""
        self._put(self._verdict, message)

    def open_view(self, commandable: bool) -> "Viewers":
        """Answer viewers that ask for the scenario, and be ready to show them frames."""
        setup = Setup(scenario=to_json(self._scenario).encode(), commandable=commandable)
        key = self._keys.scenario
        pubsub.answer(self._session, key, self._sealer.seal(key, setup))
        return Viewers(
            pubsub.publisher(self._session, self._keys.frames, pubsub.Delivery.VIEW), self._sealer
        )

    def listen_for_commands(self, deliver: pubsub.Deliver) -> None:
        """Deliver commands in a thread of Zenoh's."""
        pubsub.subscribe(self._session, self._keys.command, deliver)

    def _put(self, publisher: pubsub.Publisher, message: Message) -> None:
        publisher.put(self._sealer.seal(str(publisher.key_expr), message))


class Viewers:
    """Subscribers to the run's frames."""

    def __init__(self, publisher: pubsub.Publisher, sealer: Sealer) -> None:
        self._publisher, self._sealer = publisher, sealer

    @property
    def present(self) -> bool:
        """Whether there is anybody."""
        return pubsub.has_listener(self._publisher)

    def show(self, frame: Message) -> None:
        """Put a frame; lost on viewers that are slow."""
        self._publisher.put(self._sealer.seal(str(self._publisher.key_expr), frame))


def _open(swarm: Swarm, membership: Membership, at_router: bool) -> Session:
    if not at_router:
        return open_hub(membership.endpoint, admission(swarm, membership))
    router = membership.keys.alive(ROUTER)
    return open_member(membership.endpoint, router, membership.timeout, membership.credentials)
