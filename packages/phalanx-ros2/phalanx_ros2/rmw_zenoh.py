"""A ROS 2 node for rmw_zenoh: the key expressions, tokens and attachments of its design.

They follow docs/design.md in ros2/rmw_zenoh, as Jazzy and Kilted use it. Every ROS 2 program with
RMW_IMPLEMENTATION=rmw_zenoh_cpp sees the publishers; the node is a client of the ROS 2 router.
"""

import itertools
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass

import xxhash

from phalanx.wire import liveliness, pubsub
from phalanx.wire.session import HubError, open_client

_ATTACHMENT = struct.Struct("<qqB16s")
"""Sequence number, source timestamp [ns], and the publisher's gid behind its length."""
_GID_BYTES = 16
_QOS = "::,10:,:,:,,"
"""Reliable, volatile, keep the last 10: only the depth differs from rmw_zenoh's defaults."""
_NO_ENCLAVE = "%"


@dataclass(frozen=True)
class MessageType:
    """A ROS 2 message type: its name and the hash of its definition."""

    name: str
    """Such as "geometry_msgs/msg/PoseStamped"."""
    digest: str
    """Its RIHS01 hash; a subscriber with another definition of the type receives nothing."""

    @property
    def on_the_wire(self) -> str:
        """The type in key expressions: DDS's name, then the hash."""
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_/{self.digest}"


@dataclass(frozen=True)
class NodeName:
    """A node's name in its graph."""

    domain: int
    """ROS_DOMAIN_ID."""
    namespace: str
    """Begins with a slash: "/phalanx"."""
    name: str

    def token(self, zid: str) -> str:
        """Liveliness token of the node, in the session of this Zenoh id."""
        return self._token(zid, 0, "NN")

    def publisher_token(self, zid: str, number: int, topic: str, kind: MessageType) -> str:
        """Liveliness token of the node's publisher of this number, on an absolute topic."""
        return self._endpoint_token(zid, number, "MP", topic, kind)

    def subscription_token(self, zid: str, number: int, topic: str, kind: MessageType) -> str:
        """Liveliness token of the node's subscription of this number, on an absolute topic."""
        return self._endpoint_token(zid, number, "MS", topic, kind)

    def topic_key(self, topic: str, kind: MessageType) -> str:
        """Key expression of a topic's messages."""
        return f"{self.domain}/{topic.strip('/')}/{kind.on_the_wire}"

    def _endpoint_token(
        self, zid: str, number: int, entity: str, topic: str, kind: MessageType
    ) -> str:
        return f"{self._token(zid, number, entity)}/{_mangled(topic)}/{kind.on_the_wire}/{_QOS}"

    def _token(self, zid: str, number: int, entity: str) -> str:
        session = f"@ros2_lv/{self.domain}/{zid}/0/{number}"
        return f"{session}/{entity}/{_NO_ENCLAVE}/{_mangled(self.namespace)}/{self.name}"


def _mangled(name: str) -> str:
    """A ROS 2 name as one chunk of a key expression."""
    return name.replace("/", "%")


def gid(token: str) -> bytes:
    """A publisher's global identifier, 16 bytes: rmw_zenoh's hash of its token."""
    return xxhash.xxh3_128_intdigest(token.encode()).to_bytes(_GID_BYTES, "little")


def attachment(sequence: int, nanoseconds: int, publisher: bytes) -> bytes:
    """Attachment of a message: its number, from 1 on, its time, and its publisher's gid."""
    return _ATTACHMENT.pack(sequence, nanoseconds, _GID_BYTES, publisher)


class Node(AbstractContextManager["Node"]):
    """A node that ROS 2 programs see, with its publishers, until it is closed."""

    def __init__(self, router: str, name: NodeName, timeout: float) -> None:
        """Join the ROS 2 router. Raises HubError."""
        try:
            self._session = open_client(router, timeout)
        except HubError as error:
            raise HubError(f"{error}; is rmw_zenohd running there?") from error
        self._name, self._zid = name, str(self._session.zid())
        self._numbers = itertools.count(1)
        # A token lives as long as a reference to it.
        self._tokens = [liveliness.announce(self._session, name.token(self._zid))]

    def publisher(
        self, topic: str, kind: MessageType, delivery: pubsub.Delivery = pubsub.Delivery.VIEW
    ) -> "Publisher":
        """Announce a topic, absolute, such as "/phalanx/markers"."""
        token = self._name.publisher_token(self._zid, next(self._numbers), topic, kind)
        key = self._name.topic_key(topic, kind)
        publisher = pubsub.publisher(self._session, key, delivery)
        self._tokens.append(liveliness.announce(self._session, token))
        return Publisher(publisher, gid(token))

    def subscribe(self, topic: str, kind: MessageType, deliver: Callable[[bytes], None]) -> None:
        """Announce a subscription of an absolute topic; deliver(payload) is called in a thread.

        deliver must not wait for another message.
        """
        token = self._name.subscription_token(self._zid, next(self._numbers), topic, kind)
        self._tokens.append(liveliness.announce(self._session, token))
        key = self._name.topic_key(topic, kind)
        pubsub.subscribe(self._session, key, lambda _, payload: deliver(payload))

    def close(self) -> None:
        """Leave the graph."""
        self._session.close()  # type: ignore[no-untyped-call]

    def __exit__(self, *_: object) -> None:
        self.close()


class Publisher:
    """Puts serialized messages on a topic; a subscriber that is too slow misses some."""

    def __init__(self, publisher: pubsub.Publisher, own_gid: bytes) -> None:
        self._publisher, self._gid = publisher, own_gid
        self._sequence: Iterator[int] = itertools.count(1)

    @property
    def has_subscriber(self) -> bool:
        """True if a message would have a receiver."""
        return pubsub.has_listener(self._publisher)

    def put(self, payload: bytes) -> None:
        """Publish one message, serialized as CDR with its header."""
        added = attachment(next(self._sequence), time.time_ns(), self._gid)
        self._publisher.put(payload, attachment=added)
