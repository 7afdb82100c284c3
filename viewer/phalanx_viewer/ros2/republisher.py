"""A feed, live or recorded, published to ROS 2 until it is over."""

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
from phalanx.wire.membership import Membership
from phalanx.wire.messages import Frame
from phalanx_viewer.feeds.feed import Feed, stop_request
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.ros2 import messages
from phalanx_viewer.ros2.diagnostics import Head, alike, diagnostics, so_far, verdict
from phalanx_viewer.ros2.messages import message_type, serialized, stamped
from phalanx_viewer.ros2.rmw_zenoh import Node, NodeName
from phalanx_viewer.scene.kinematics import Poses

log = logging.getLogger("phalanx.ros2")

_TICK = 1.0 / 30.0
"""Wall time between two looks at the feed [s]: the plant tells no more of a run."""
_NODE = "swarm"
_ANEW = 1.0
"""How often what did not change is told again, for those who came late [s of wall time]."""
NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
"""ROS 2's namespaces, but for the root."""


class Graph(NamedTuple):
    """Where in ROS 2 the topics go."""

    router: str
    """Zenoh endpoint of its router."""
    domain: int
    """ROS_DOMAIN_ID."""
    namespace: str
    """Such as "/phalanx"."""
    timeout: float
    """How long to try to reach the router [s]."""


def run_live(membership: Membership, graph: Graph, *, trust: bool = False) -> int:
    """Publish a run that goes on until it is over, or until SIGINT or SIGTERM.

    Args:
        membership: of the run, as a viewer.
        graph: where to.
        trust: whether code that the run's scenario names may be imported.

    Returns:
        Exit status 0.

    Raises:
        HubError, NoRunError: there is no such router, or no such run.
        ScenarioError: its scenario names code that is not trusted.
        ValueError: two agents would share a topic.
    """
    with Live(membership, trust=trust) as live:
        return _publish(live, graph, lambda: live.over)


def run_replay(recording: Path, graph: Graph, *, trust: bool = False) -> int:
    """Publish a run folder or recording file once, in real time; otherwise as run_live.

    Raises:
        UnreadableRecordingError: nothing to replay.
    """
    replay = open_replay(recording, trust)
    replay.play(True)
    return _publish(replay, graph, lambda: not replay.playing)


def _publish(feed: Feed, graph: Graph, over: Callable[[], bool]) -> int:
    told_to_stop = stop_request()
    name = NodeName(graph.domain, graph.namespace, _NODE)
    with Node(graph.router, name, graph.timeout) as node:
        republisher = Republisher(node, graph.namespace, feed)
        log.info("ROS 2 node %s/%s in domain %d", graph.namespace, _NODE, graph.domain)
        while not (over() or told_to_stop()):
            republisher.tick()
            time.sleep(_TICK)
        if over():
            republisher.finish()
    return 0


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
