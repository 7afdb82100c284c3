"""Robots of ROS 2: their odometry in, their velocities out."""

import logging
import math
import threading
import time
from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Twist as Twist
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__TwistStamped as TwistStamped
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Odometry as Odometry

from phalanx.theory.arrays import Array
from phalanx.wire.pubsub import Delivery
from phalanx_ros2.cdr import deserialized, header, message_type, serialized
from phalanx_ros2.rmw_zenoh import Node, NodeName

log = logging.getLogger("phalanx.ros2")
_DOMAIN = 0
"""ROS_DOMAIN_ID of the robots."""
_POSES: Mapping[str, type] = {"Odometry": Odometry, "PoseStamped": PoseStamped}
_VELOCITIES: Mapping[str, type] = {"Twist": Twist, "TwistStamped": TwistStamped}


class Reading(NamedTuple):
    """A robot's odometry, in the scenario's coordinates."""

    arrived: float
    """On the monotonic clock [s]: a robot's own clock may be another."""
    pose: Array
    """x, y [m], turn [rad]."""
    velocity: Array
    """[m/s], shape (2,); zero of a PoseStamped."""


class Robots:
    """A node with a subscription and a publisher for each robot."""

    def __init__(
        self, router: str, tables: Mapping[str, Mapping[str, Any]], timeout: float
    ) -> None:
        """Join the ROS 2 router; tables: as `RobotTable.of`, by agent. Raises HubError."""
        self._tables, self._readings = tables, dict[str, Reading]()
        self._changed = threading.Condition()
        self._node = Node(router, NodeName(_DOMAIN, "/phalanx", "world"), timeout)
        self._publishers = {
            name: self._node.publisher(
                table["command"],
                message_type(_VELOCITIES[table["command_type"]]),
                Delivery.NOTICE,
            )
            for name, table in tables.items()
        }
        for name, table in tables.items():
            kind = message_type(_POSES[table["odometry_type"]])
            self._node.subscribe(table["odometry"], kind, partial(self._take, name))

    def first(self, name: str, timeout: float) -> Reading:
        """Wait for a robot's first odometry. Raises ValueError."""
        with self._changed:
            if not self._changed.wait_for(lambda: name in self._readings, timeout):
                table = self._tables[name]
                raise ValueError(
                    f"agent {name}: no {table['odometry_type']} on {table['odometry']} in frame "
                    f"{table['frame']} within {timeout:g} s"
                )
            return self._readings[name]

    def newest(self, name: str) -> Reading:
        """Return a robot's newest odometry."""
        return self._readings[name]

    def send(self, name: str, velocity: Array) -> None:
        """Command a velocity: ahead, left [m/s], turn [rad/s]."""
        ahead, sideways, turn = velocity.tolist()
        table = self._tables[name]
        message: Any = Twist(
            linear=Vector3(x=ahead, y=sideways, z=0.0), angular=Vector3(x=0.0, y=0.0, z=turn)
        )
        if table["command_type"] == "TwistStamped":
            message = TwistStamped(header=header(time.time(), table["base"]), twist=message)
        self._publishers[name].put(serialized(message))

    def close(self) -> None:
        """Leave ROS 2."""
        self._node.close()

    def _take(self, name: str, payload: bytes) -> None:
        """Keep a robot's odometry, in Zenoh's thread; drop what is none."""
        table = self._tables[name]
        try:
            message = deserialized(payload, _POSES[table["odometry_type"]])
            reading = reading_of(message, table["frame"], table["origin"])
        except Exception as error:  # bytes from elsewhere may raise anything
            log.warning("agent %s: odometry dropped: %s", name, error)
            return
        with self._changed:
            self._readings[name] = reading
            self._changed.notify_all()


def reading_of(message: Any, frame: str, origin: tuple[float, float, float]) -> Reading:
    """Return an Odometry or a PoseStamped in the scenario's coordinates. Raises ValueError."""
    if message.header.frame_id != frame:
        raise ValueError(f"expected frame {frame}, got {message.header.frame_id}")
    odometry = hasattr(message, "twist")
    pose = message.pose.pose if odometry else message.pose
    q = pose.orientation
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
    turn = yaw + origin[2]
    x, y = _turned(pose.position.x, pose.position.y, origin[2])
    # Twists of an Odometry are in the robot's own axes.
    twist = message.twist.twist.linear if odometry else Vector3(x=0.0, y=0.0, z=0.0)
    reading = Reading(
        time.monotonic(),
        np.array([origin[0] + x, origin[1] + y, turn]),
        np.array(_turned(twist.x, twist.y, turn)),
    )
    if not (np.isfinite(reading.pose).all() and np.isfinite(reading.velocity).all()):
        raise ValueError("not finite")
    return reading


def _turned(x: float, y: float, by: float) -> tuple[float, float]:
    c, s = math.cos(by), math.sin(by)
    return c * x - s * y, s * x + c * y
