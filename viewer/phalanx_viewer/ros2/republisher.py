"""A feed's frames, published to ROS 2."""

import re
import time
from collections.abc import Sequence

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray

from phalanx.arrays import Array
from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.feed import Feed
from phalanx_viewer.ros2 import messages
from phalanx_viewer.ros2.diagnostics import Head, alike, diagnostics, so_far, verdict
from phalanx_viewer.ros2.messages import message_type, serialized, stamped
from phalanx_viewer.ros2.rmw_zenoh import Node
from phalanx_viewer.scene.kinematics import Poses

_ANEW = 1.0
"""How often what did not change is told again, for those who came late [s of wall time]."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
"""ROS 2's namespaces, but for the root."""


class Republisher:
    """Publishers for a swarm; makes no message that nobody subscribes to."""

    def __init__(self, node: Node, namespace: str, feed: Feed) -> None:
        """Announce all topics. Raises ValueError if two agents would share one."""
        self._feed, self._model = feed, feed.model
        pose = message_type(PoseStamped)
        topics = pose_topics(namespace, feed.model.names)
        self._poses = [node.publisher(topic, pose) for topic in topics]
        self._markers = node.publisher(f"{namespace}/markers", message_type(MarkerArray))
        self._diagnostics = node.publisher("/diagnostics", message_type(Diagnostics))
        self._last: Frame | None = None
        self._told: Diagnostics | None = None
        self._due = 0.0

    def tick(self) -> None:
        """Publish the newest frame, unless it was."""
        if (frame := self._feed.take()) is None:
            return
        self._last = frame
        again = time.monotonic() >= self._due
        if again:
            self._due = time.monotonic() + _ANEW
        x = np.frombuffer(frame.x, dtype="<f8")
        poses = self._model.kinematics.poses(x)
        self._put_poses(frame, poses)
        self._put_markers(frame, x, poses, again)
        self._put_diagnostics(frame, so_far(frame), again)

    def finish(self) -> None:
        """Tell the verdict, and the last frame with it."""
        self.tick()
        if self._last is not None:
            self._put_diagnostics(self._last, verdict(self._feed.summary), True)

    def _put_poses(self, frame: Frame, poses: Poses) -> None:
        for publisher, message in zip(self._poses, stamped(frame.t, poses), strict=True):
            if publisher.heard:
                publisher.put(serialized(message))

    def _put_markers(self, frame: Frame, x: Array, poses: Poses, again: bool) -> None:
        if not self._markers.heard:
            return
        model, unsafe = self._model, [int(pair) for pair in self._model.values.unsafe(x)]
        moving = messages.agents(frame.t, model, poses, frame.agents, unsafe)
        violated = messages.violations(frame.t, model, poses.positions, unsafe)
        still = messages.around(frame.t, model) if again else iter(())
        self._markers.put(serialized(messages.array(moving, violated, still)))

    def _put_diagnostics(self, frame: Frame, outcome: Head, again: bool) -> None:
        if not self._diagnostics.heard:
            return
        told = diagnostics(frame, self._model, outcome)
        if again or not alike(self._told, told):
            self._told = told
            self._diagnostics.put(serialized(told))


def pose_topics(namespace: str, names: Sequence[str]) -> list[str]:
    """The topic of each agent's pose, such as "/phalanx/agent_1/pose".

    ROS 2 has no "-" in names and no digit at their beginning, as agents' may have. Raises
    ValueError if two agents would share a topic.
    """
    topics = [f"{namespace}/agent_{name.replace('-', '_')}/pose" for name in names]
    for name, topic in zip(names, topics, strict=True):
        other = names[topics.index(topic)]
        if other != name:
            raise ValueError(f"agents {other} and {name} would share the topic {topic}")
    return topics
