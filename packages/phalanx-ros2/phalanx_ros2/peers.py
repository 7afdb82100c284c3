"""Odometry of peers by radio, as each agent heard it, with the stamp of the state's sample."""

import numpy as np
from phalanx_viewer.scene.model import SceneModel
from rosbags.typesys.stores import ros2_jazzy as ros
from rosbags.typesys.stores.ros2_jazzy import nav_msgs__msg__Odometry as Odometry

from phalanx.network.inbox import SentInput
from phalanx.recording.curves.beliefs import Beliefs
from phalanx.swarm.points import agent_point
from phalanx_ros2 import cdr, messages
from phalanx_ros2.rmw_zenoh import Node


class PeerOdometry:
    """Publishers of what each agent heard of each of its peers, every statement once."""

    def __init__(self, node: Node, topics: list[str], model: SceneModel, radio: Beliefs) -> None:
        """Announce all topics; topics: of each agent, such as "/phalanx/agent_1"."""
        self._model, self._radio, kind = model, radio, cdr.message_type(Odometry)
        self._names = [topic.rpartition("/")[2] for topic in topics]
        self._publishers = {
            (i, l): node.publisher(f"{topics[i]}/peers/{self._names[l]}", kind)
            for i in radio.news
            for l in radio.news
            if i != l
        }
        self._published = dict.fromkeys(radio.news, 0)
        """By agent, how many of its news."""

    def put(self, t: float) -> None:
        """Publish what agents heard until t [s]."""
        for i, news in self._radio.news.items():
            until = sum(each.t <= t for each in news)
            for each in news[self._published[i] : until]:
                publisher, name = self._publishers[i, each.peer], self._names[each.peer]
                if each.said and publisher.has_subscriber:
                    message = odometry(self._model, each.peer, each.said, name)
                    publisher.put(cdr.serialized(message))
            self._published[i] = max(until, self._published[i])


def odometry(model: SceneModel, l: int, statement: SentInput, child: str) -> Odometry:
    """Return the odometry of agent l as it stated it, without covariances; child: its frame."""
    swarm, state, point = model.swarm, np.array(statement.x), agent_point(model.swarm, l)
    x = swarm.start()
    x[swarm.safe_set.parts[l]] = state
    poses = model.kinematics.poses(x)
    axes, heading = point.motion.axes, poses.headings[l]
    moves = point.input(state, np.array(statement.u)) if point.motion.jumps else state[axes:]
    v = np.pad(moves, (0, 3 - axes))
    # In the agent's own axes; where it has no heading, it moves along its x-axis.
    leftward = np.array([-heading[1], heading[0], 0.0])
    twist = ros.geometry_msgs__msg__Twist(
        linear=ros.geometry_msgs__msg__Vector3(x=float(heading @ v), y=float(leftward @ v), z=0.0),
        angular=ros.geometry_msgs__msg__Vector3(x=0.0, y=0.0, z=0.0),
    )
    unknown = np.zeros(36)
    pose = messages.pose(poses.positions[l], heading)
    return Odometry(
        header=cdr.header(statement.t, messages.WORLD),
        child_frame_id=child,
        pose=ros.geometry_msgs__msg__PoseWithCovariance(pose=pose, covariance=unknown),
        twist=ros.geometry_msgs__msg__TwistWithCovariance(twist=twist, covariance=unknown),
    )
