"""ROS 2 messages of a swarm: poses and markers."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Duration as Duration
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Point as Point
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Quaternion as Quaternion
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__CompressedImage as Image
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__ColorRGBA as ColorRGBA
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__Marker as Marker
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MeshFile as MeshFile

from phalanx.arrays import Array
from phalanx.ros2 import cdr
from phalanx.wire.messages import AgentStatus
from phalanx_viewer.scene.colours import COLOURS, DANGER, role
from phalanx_viewer.scene.kinematics import Poses, rotations_to
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.shapes import Kind, Shape, agent_shapes, static_shapes

WORLD = "world"
"""The fixed frame of all positions."""
_TYPES = {
    Kind.ARROW: Marker.ARROW,
    Kind.TEXT: Marker.TEXT_VIEW_FACING,
    Kind.BALL: Marker.SPHERE,
    Kind.DISC: Marker.CYLINDER,
    Kind.BOX: Marker.CUBE,
    Kind.LINE: Marker.LINE_STRIP,
}
_NAMESPACES = {
    "agent": "agents",
    "name": "names",
    "obstacle": "obstacles",
    "wall": "walls",
    "limit": "limits",
    "path": "formation",
}


def header(t: float) -> Header:
    """Header of a message about virtual time t [s], which is its stamp."""
    return cdr.header(t, WORLD)


def pose_messages(t: float, poses: Poses) -> Iterator[PoseStamped]:
    """Each agent's pose at t [s]."""
    now = header(t)
    for place, heading in zip(poses.positions, poses.headings, strict=True):
        yield PoseStamped(header=now, pose=_pose(place, heading))


def agents(
    t: float, model: SceneModel, poses: Poses, status: Sequence[AgentStatus], unsafe: Sequence[int]
) -> Iterator[Marker]:
    """Every agent, its name and its safety radius, coloured by its role.

    Agents of `unsafe`, the violated pairs, are red.
    """
    now, violated = header(t), model.agents_of(list(unsafe))
    for i, pose in enumerate(zip(poses.positions, poses.headings, strict=True)):
        colour = DANGER if i in violated else COLOURS[role(status[i], bool(model.adversary[i]))]
        for shape in agent_shapes(model, i, colour, *pose):
            yield _marker(now, shape, model)


def violations(
    t: float, model: SceneModel, positions: Array, unsafe: Sequence[int]
) -> Iterator[Marker]:
    """A red line between the sides of every violated pair; positions [m], shape (N, 3)."""
    ends = [end for pair in unsafe for end in model.ends(pair, positions)]
    lines = Shape("violated pairs", 0, Kind.LINE, DANGER, points=np.array(ends).reshape(-1, 3))
    drawn = _marker(header(t), lines, model)
    drawn.type = Marker.LINE_LIST
    # Without violated pairs, earlier lines are deleted.
    drawn.action = Marker.ADD if ends else Marker.DELETE
    yield drawn


def static_markers(t: float, model: SceneModel) -> Iterator[Marker]:
    """Obstacles, walls, limits and the formation's path."""
    now = header(t)
    return (_marker(now, shape, model) for shape in static_shapes(model))


def array(*markers: Iterator[Marker]) -> MarkerArray:
    """Put markers into one message."""
    # The library types the elements as those of ROS 2's first release.
    every: list[Any] = [marker for some in markers for marker in some]
    return MarkerArray(markers=every)


def _marker(now: Header, shape: Shape, model: SceneModel) -> Marker:
    """Convert a shape to a marker, which stays until one of the same name and number comes."""
    x, y, z = (0.15 * model.body, 0.0, 0.0) if shape.kind is Kind.LINE else shape.size
    red, green, blue = (part / 255 for part in shape.colour)
    nothing = np.zeros(0, dtype=np.uint8)
    then = Header(stamp=Time(sec=0, nanosec=0), frame_id="")
    return Marker(
        header=now,
        ns=_NAMESPACES.get(shape.group, shape.group),
        id=shape.number,
        type=_TYPES[shape.kind],
        action=Marker.ADD,
        pose=_pose(shape.place, shape.heading),
        scale=Vector3(x=x, y=y, z=z),
        color=ColorRGBA(r=red, g=green, b=blue, a=shape.opacity),
        lifetime=Duration(sec=0, nanosec=0),
        frame_locked=False,
        points=[_point(one) for one in shape.points],
        colors=[],
        texture_resource="",
        texture=Image(header=then, format="", data=nothing),
        uv_coordinates=[],
        text=shape.text,
        mesh_resource="",
        mesh_file=MeshFile(filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )


def _pose(place: Array, heading: Array) -> Pose:
    """A pose at a place [m], shape (3,), whose x-axis is along a unit heading, shape (3,)."""
    w, x, y, z = rotations_to(heading[None])[0].tolist()
    return Pose(position=_point(place), orientation=Quaternion(x=x, y=y, z=z, w=w))


def _point(place: Array) -> Point:
    x, y, z = place.tolist()
    return Point(x=x, y=y, z=z)
