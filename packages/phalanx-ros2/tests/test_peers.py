"""Odometry of peers: each statement once, with its own stamp, on the topic of who heard it."""

from collections import defaultdict

import numpy as np
import pytest
from phalanx_ros2.peers import PeerOdometry, odometry
from phalanx_ros2.robots import reading_of
from phalanx_viewer.feeds.replay import Replay

import phalanx
from examples.ros2_robots import robot
from phalanx.swarm.statements import OwnStatement


class Topic:
    """A publisher that keeps what it puts."""

    has_subscriber = True

    def __init__(self):
        self.put_there = []

    def put(self, payload):
        self.put_there.append(robot.Odometry.deserialize(payload))


class Topics(defaultdict):
    """A node without ROS 2."""

    def __init__(self):
        super().__init__(Topic)

    def publisher(self, topic, kind):
        return self[topic]


def test_each_statement_is_published_once_with_the_stamp_of_its_sample():
    scenario = phalanx.load("radio", {"duration": 1.0, "faults": []})
    replay, node = Replay(phalanx.run(scenario, engine="in-process").recording), Topics()
    names = [f"/x/agent_{name}" for name in replay.model.names]
    peers = PeerOdometry(node, names, replay.model, replay.radio)
    assert len(node) == 8 * 7
    for t in np.linspace(0.0, 1.0, 21):
        peers.put(float(t))
    heard = [news for news in replay.radio.news[0] if news.peer == 2]
    shown = node["/x/agent_1/peers/agent_3"].put_there
    stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in shown]
    assert stamps == pytest.approx([news.said.t for news in heard], abs=1e-8)
    assert len(stamps) > 2
    for message, news in zip(shown, heard, strict=True):
        at, there = reading_of(message, "world", (0.0, 0.0, 0.0)), np.array(news.said.x)
        assert at.pose[:2] == pytest.approx(there[:2])
        assert at.velocity == pytest.approx(there[2:], abs=1e-9)
        assert message.child_frame_id == "agent_3"


def test_a_unicycles_twist_is_what_it_announced():
    scenario = phalanx.load("crossing-radio", {"duration": 0.2, "faults": []})
    replay = Replay(phalanx.run(scenario, engine="in-process").recording)
    said = OwnStatement(3, 0.5, (1.0, 2.0, 0.7), 0.5, (1.5, 0.4))
    twist = odometry(replay.model, 0, said, "agent_east").twist.twist.linear
    assert (twist.x, twist.y) == pytest.approx((1.5, 0.4 * 0.25))
