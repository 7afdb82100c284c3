"""ROS 2 messages as bytes: CDR, little-endian, and what a topic of them is called on the wire."""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header

from phalanx_viewer.ros2.rmw_zenoh import MessageType

WORLD = "world"
"""The frame that everything is told in; it stands still."""
_STORE = get_typestore(Stores.ROS2_JAZZY)


def header(t: float) -> Header:
    """Of a message about virtual time t [s], which is its stamp."""
    seconds, nanoseconds = divmod(round(t * 1e9), 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=WORLD)


@cache
def message_type(kind: type) -> MessageType:
    """Name and hash of a class of messages."""
    name: str = kind.__msgtype__  # type: ignore[attr-defined]
    return MessageType(name, _STORE.hash_rihs01(name))


def serialized(message: Any) -> bytes:
    """A message of one of the library's classes, with CDR's header of four bytes."""
    return bytes(_STORE.serialize_cdr(message, message.__msgtype__, little_endian=True))
