"""ROS 2 messages as bytes: little-endian CDR, with types and hashes of ROS 2 Jazzy."""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header

from phalanx_ros2.rmw_zenoh import MessageType

_STORE = get_typestore(Stores.ROS2_JAZZY)


@cache
def message_type(kind: type) -> MessageType:
    """Type name and hash of a class of messages."""
    name: str = kind.__msgtype__  # type: ignore[attr-defined]
    return MessageType(name, _STORE.hash_rihs01(name))


def serialized(message: Any) -> bytes:
    """Serialize a message, with CDR's header of four bytes."""
    return bytes(_STORE.serialize_cdr(message, message.__msgtype__, little_endian=True))


def deserialized(payload: bytes, kind: type) -> Any:
    """Deserialize a message of this class. Raises Exception of any kind: bytes are not trusted."""
    return _STORE.deserialize_cdr(payload, message_type(kind).name)


def header(t: float, frame: str) -> Header:
    """Header of a message about time t [s], which is its stamp, in a frame."""
    seconds, nanoseconds = divmod(round(t * 1e9), 1_000_000_000)
    return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id=frame)
