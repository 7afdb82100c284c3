"""Publish a feed, live or recorded, to ROS 2 until it is over."""

import logging
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray

from phalanx.arrays import Array
from phalanx.ros2.cdr import message_type, serialized
from phalanx.ros2.rmw_zenoh import Node, NodeName
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.feed import Feed, stop_request
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.ros2 import messages
from phalanx_viewer.ros2.diagnostics import Head, diagnostics, heads, interim_outcome, outcome
from phalanx_viewer.ros2.messages import pose_messages
from phalanx_viewer.scene.kinematics import Poses

log = logging.getLogger("phalanx.ros2")

_TICK = 1.0 / 30.0
"""Wall time between two reads of the feed [s]: the plant sends frames no faster."""
_NODE = "swarm"
_REPEAT_PERIOD = 1.0
"""Wall time after which unchanged messages are sent again, for new subscribers [s]."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
"""ROS 2's namespaces, but for the root."""


class Graph(NamedTuple):
    """The ROS 2 graph to publish in."""

    router: str
    """Zenoh endpoint of its router."""
    domain: int
    """ROS_DOMAIN_ID."""
    namespace: str
    """Such as "/phalanx"."""
    timeout: float
    """Longest time to try to reach the router [s]."""


def run_live(membership: Membership, graph: Graph, *, trust: bool = False) -> int:
    """Publish a live run until it is over, or until SIGINT or SIGTERM; return exit status 0.

    trust: whether code that the run's scenario names may be imported.

    Raises HubError, NoRunError, ScenarioError, and ValueError if two agents would share a topic.
    """
    with Live(membership, trust=trust) as live:
        return _publish(live, graph, lambda: live.over)


def run_replay(recording: Path, graph: Graph, *, trust: bool = False) -> int:
    """Publish a run folder or recording file once, in real time; otherwise as run_live.

    Raises UnreadableRecordingError.
    """
    replay = open_replay(recording, trust)
    replay.play(True)
    return _publish(replay, graph, lambda: not replay.playing)


def _publish(feed: Feed, graph: Graph, over: Callable[[], bool]) -> int:
    stop_requested = stop_request()
    name = NodeName(graph.domain, graph.namespace, _NODE)
    with Node(graph.router, name, graph.timeout) as node:
        republisher = Republisher(node, graph.namespace, feed)
        log.info("ROS 2 node %s/%s in domain %d", graph.namespace, _NODE, graph.domain)
        while not (over() or stop_requested()):
            republisher.tick()
            time.sleep(_TICK)
        if over():
            republisher.finish()
    return 0


class Republisher:
    """Publishers for a swarm; makes only messages that have a subscriber."""

    def __init__(self, node: Node, namespace: str, feed: Feed) -> None:
        """Announce all topics. Raises ValueError if two agents would share one."""
        self._feed, self._model = feed, feed.model
        pose = message_type(PoseStamped)
        topics = pose_topics(namespace, feed.model.names)
        self._poses = [node.publisher(topic, pose) for topic in topics]
        self._markers = node.publisher(f"{namespace}/markers", message_type(MarkerArray))
        self._diagnostics = node.publisher("/diagnostics", message_type(Diagnostics))
        self._last: Frame | None = None
        self._heads: list[Head] = []
        self._due = 0.0

    def tick(self) -> None:
        """Publish the newest frame, unless it was published before."""
        if (frame := self._feed.take()) is None:
            return
        self._last = frame
        again = time.monotonic() >= self._due
        if again:
            self._due = time.monotonic() + _REPEAT_PERIOD
        x = np.frombuffer(frame.x, dtype="<f8")
        poses = self._model.kinematics.poses(x)
        self._put_poses(frame, poses)
        self._put_markers(frame, x, poses, again)
        self._put_diagnostics(frame, interim_outcome(frame), again)

    def finish(self) -> None:
        """Publish the verdict with the last frame."""
        self.tick()
        if self._last is not None:
            self._put_diagnostics(self._last, outcome(self._feed.summary), True)

    def _put_poses(self, frame: Frame, poses: Poses) -> None:
        for publisher, message in zip(self._poses, pose_messages(frame.t, poses), strict=True):
            if publisher.has_subscriber:
                publisher.put(serialized(message))

    def _put_markers(self, frame: Frame, x: Array, poses: Poses, again: bool) -> None:
        if not self._markers.has_subscriber:
            return
        model, unsafe = self._model, [int(pair) for pair in self._model.values.unsafe(x)]
        moving = messages.agents(frame.t, model, poses, frame.agents, unsafe)
        violated = messages.violations(frame.t, model, poses.positions, unsafe)
        static = messages.static_markers(frame.t, model) if again else iter(())
        self._markers.put(serialized(messages.array(moving, violated, static)))

    def _put_diagnostics(self, frame: Frame, head: Head, again: bool) -> None:
        if not self._diagnostics.has_subscriber:
            return
        message = diagnostics(frame, self._model, head)
        if again or heads(message) != self._heads:
            self._heads = heads(message)
            self._diagnostics.put(serialized(message))


def pose_topics(namespace: str, names: Sequence[str]) -> list[str]:
    """The topic of each agent's pose, such as "/phalanx/agent_1/pose".

    ROS 2 allows no "-" in names and no digit at their beginning; agents' names may have both.
    Raises ValueError if two agents would share a topic.
    """
    topics = [f"{namespace}/agent_{name.replace('-', '_')}/pose" for name in names]
    for name, topic in zip(names, topics, strict=True):
        other = names[topics.index(topic)]
        if other != name:
            raise ValueError(f"agents {other} and {name} would share the topic {topic}")
    return topics
