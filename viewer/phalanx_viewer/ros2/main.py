"""The shell of `phalanx ros2`: a feed, live or recorded, published to ROS 2 until it is over."""

import logging
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from phalanx.wire.membership import Membership
from phalanx_viewer.feeds.feed import Feed, stop_request
from phalanx_viewer.feeds.live import Live
from phalanx_viewer.feeds.replay import open_replay
from phalanx_viewer.ros2.republisher import Republisher
from phalanx_viewer.ros2.rmw_zenoh import Node, NodeName

log = logging.getLogger("phalanx.ros2")

_TICK = 1.0 / 30.0
"""Wall time between two looks at the feed [s]: the plant tells no more of a run."""
_NODE = "swarm"


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
