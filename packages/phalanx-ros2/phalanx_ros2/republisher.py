"""Publish a feed, live or recorded, to ROS 2 until it is over."""

import logging
import re
import time
from collections.abc import Sequence

import numpy as np
from phalanx_viewer.feeds import Feed, keep_up, stop_request
from phalanx_viewer.feeds.replay import Replay
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray

from phalanx.messages.frames import Frame
from phalanx_ros2 import messages
from phalanx_ros2.cdr import message_type, serialized
from phalanx_ros2.peers import PeerOdometry
from phalanx_ros2.rmw_zenoh import Node, NodeName

log = logging.getLogger("phalanx.ros2")

_REPEAT_PERIOD = 1.0
"""Wall time after which unchanged messages are sent again, for new subscribers [s]."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
"""ROS 2's namespaces, but for the root."""


def publish(feed: Feed, router: str, name: NodeName, timeout: float) -> int:
    """Publish a live run until it is over, or play and publish a recording once; return status 0.

    It ends at SIGINT and SIGTERM, too.

    Raises ValueError if two agents would share a topic, and HubError without a router.
    """
    stop_requested = stop_request()
    with Node(router, name, timeout) as node:
        republisher = Republisher(node, name.namespace, feed)
        log.info("ROS 2 node %s/%s in domain %d", name.namespace, name.name, name.domain)
        if isinstance(feed, Replay):
            feed.play(True)  # not before: what it plays is lost until the node has joined
        keep_up(republisher.tick, lambda: _over(feed) or stop_requested())
        if _over(feed):
            republisher.finish()
    return 0


def _over(feed: Feed) -> bool:
    return not feed.playing if isinstance(feed, Replay) else feed.over


class Republisher:
    """Publishers for a swarm; makes only messages that have a subscriber."""

    def __init__(self, node: Node, namespace: str, feed: Feed) -> None:
        """Announce all topics. Raises ValueError if two agents would share one."""
        self._feed, self._model = feed, feed.model
        pose = message_type(PoseStamped)
        topics = agent_topics(namespace, feed.model.names)
        self._poses = [node.publisher(f"{topic}/pose", pose) for topic in topics]
        radio = None if feed.model.crowded else feed.radio
        self._peers = PeerOdometry(node, topics, feed.model, radio) if radio else None
        self._markers = node.publisher(f"{namespace}/markers", message_type(MarkerArray))
        self._diagnostics = node.publisher("/diagnostics", message_type(Diagnostics))
        self._last: Frame | None = None
        self._heads: list[messages.Head] = []
        self._due = 0.0

    def tick(self) -> None:
        """Publish the newest frame, unless it was published before."""
        if (frame := self._feed.take()) is None:
            return
        self._last = frame
        again = time.monotonic() >= self._due
        if again:
            self._due = time.monotonic() + _REPEAT_PERIOD
        x, model = np.frombuffer(frame.x, dtype="<f8"), self._model
        poses = model.kinematics.poses(x)
        every = messages.pose_messages(frame.t, poses)
        for publisher, message in zip(self._poses, every, strict=True):
            if publisher.has_subscriber:
                publisher.put(serialized(message))
        if self._markers.has_subscriber:
            unsafe = model.values.unsafe(x, frame.turned).tolist()
            moving = messages.agents(frame.t, model, poses, frame.agents, unsafe)
            violated = messages.violations(frame.t, model, poses.positions, unsafe)
            static = messages.static_markers(frame.t, model) if again else ()
            self._markers.put(serialized(messages.array(moving, violated, static)))
        if self._peers:
            self._peers.put(frame.t)
        self._put_diagnostics(frame, messages.interim_head(frame), again)

    def finish(self) -> None:
        """Publish the verdict with the last frame."""
        self.tick()
        if self._last is not None:
            head = messages.last_head(self._feed.summary, self._feed.unfinished)
            self._put_diagnostics(self._last, head, True)

    def _put_diagnostics(self, frame: Frame, head: messages.Head, again: bool) -> None:
        if not self._diagnostics.has_subscriber:
            return
        message = messages.diagnostics(frame, self._model, head)
        heads = messages.heads(message)
        if again or heads != self._heads:
            self._heads = heads
            self._diagnostics.put(serialized(message))


def agent_topics(namespace: str, names: Sequence[str]) -> list[str]:
    """Return each agent's part of the topics, such as "/phalanx/agent_1".

    ROS 2 allows no "-" in names and no digit at their beginning; agents' names may have both.
    Raises ValueError if two agents would share a topic.
    """
    topics = [f"{namespace}/agent_{name.replace('-', '_')}" for name in names]
    for name, topic in zip(names, topics, strict=True):
        other = names[topics.index(topic)]
        if other != name:
            raise ValueError(f"agents {other} and {name} would share the topic {topic}/pose")
    return topics
