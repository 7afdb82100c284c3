"""Where every agent is, as PoseStamped."""

from collections.abc import Iterator

from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Quaternion as Quaternion

from phalanx.arrays import Array
from phalanx_viewer.ros2.serialized import header
from phalanx_viewer.scene.geometry import facing
from phalanx_viewer.scene.kinematics import Poses


def pose_at(place: Array, heading: Array) -> Pose:
    """A pose at a place [m], shape (3,), whose x-axis is along a unit heading, shape (3,)."""
    w, x, y, z = facing(heading[None])[0].tolist()
    return Pose(position=point(place), orientation=Quaternion(x=x, y=y, z=z, w=w))


def point(place: Array) -> Point:
    """A place [m], shape (3,)."""
    x, y, z = place.tolist()
    return Point(x=x, y=y, z=z)


def stamped(t: float, poses: Poses) -> Iterator[PoseStamped]:
    """Each agent's pose at t [s]."""
    now = header(t)
    for place, heading in zip(poses.positions, poses.headings, strict=True):
        yield PoseStamped(header=now, pose=pose_at(place, heading))
