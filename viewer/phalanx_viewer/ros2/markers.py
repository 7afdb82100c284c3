"""The scene as markers: agents with their safety radius, what stands still, violated pairs."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Duration as Duration
from rosbags.typesys.stores.ros2_jazzy import builtin_interfaces__msg__Time as Time
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Pose as Pose
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__Vector3 as Vector3
from rosbags.typesys.stores.ros2_jazzy import sensor_msgs__msg__CompressedImage as Image
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__ColorRGBA as ColorRGBA
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__Marker as Marker
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MeshFile as MeshFile

from phalanx.arrays import Array
from phalanx.wire.messages import AgentStatus
from phalanx_viewer.ros2.poses import point, pose_at
from phalanx_viewer.ros2.serialized import header
from phalanx_viewer.scene.kinematics import Poses
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.palette import DANGER, OBSTACLE, Colour
from phalanx_viewer.scene.roles import COLOURS, role

_FAINT = 0.25
_THIN = 0.02
"""Height of a disc in the plane [m]."""
_WALL = (0.1, 40.0)
"""How thick and long a wall is drawn [m]."""
_ORIGIN, _NO_TURN, _UP = np.zeros(3), np.zeros(3), np.array([0.0, 0.0, 1.0])


def agents(
    t: float, model: SceneModel, poses: Poses, told: Sequence[AgentStatus], unsafe: Sequence[int]
) -> Iterator[Marker]:
    """Every agent, its name and its safety radius, coloured by its role; red if a pair is violated.

    Args:
        t: virtual time [s].
        model: of the swarm.
        poses: at t.
        told: of each agent.
        unsafe: the violated pairs.
    """
    now, violated = header(t), model.agents_of(list(unsafe))
    for i, (place, heading) in enumerate(zip(poses.positions, poses.headings, strict=True)):
        adversary = bool(model.adversary[i])
        colour = DANGER if i in violated else COLOURS[role(told[i], adversary)]
        body, reach = model.body, 2.0 * model.radius
        tail = pose_at(place - body * heading, heading)
        size = (2.0 * body, body, body)
        yield _marker(now, "agents", i, Marker.ARROW, tail, size, colour)
        above = pose_at(place + 1.5 * body * _UP, _NO_TURN)
        text = Marker.TEXT_VIEW_FACING
        yield _marker(now, "names", i, text, above, (0, 0, body), colour, text=model.names[i])
        if reach:
            kind, height = (Marker.CYLINDER, _THIN) if model.flat else (Marker.SPHERE, reach)
            here, size = pose_at(place, _NO_TURN), (reach, reach, height)
            yield _marker(now, "safety radius", i, kind, here, size, colour, _FAINT)


def violations(
    t: float, model: SceneModel, positions: Array, unsafe: Sequence[int]
) -> Iterator[Marker]:
    """A red line between the sides of every violated pair; positions has shape (N, 3)."""
    ends = [end for pair in unsafe for end in model.ends(pair, positions)]
    yield _lines(header(t), "violated pairs", 0, Marker.LINE_LIST, np.array(ends), DANGER, model)


def surroundings(t: float, model: SceneModel) -> Iterator[Marker]:
    """Obstacles, walls, limits and the formation's path."""
    around, now, strip = model.surroundings, header(t), Marker.LINE_STRIP
    for k, (center, radius) in enumerate(around.spheres):
        place, size = pose_at(center, _NO_TURN), (2.0 * radius,) * 3
        yield _marker(now, "obstacles", k, Marker.SPHERE, place, size, OBSTACLE)
    thick, long = _WALL
    for k, (surface, normal) in enumerate(around.walls):
        place, size = pose_at(surface + 0.5 * thick * normal, normal), (thick, long, long)
        yield _marker(now, "walls", k, Marker.CUBE, place, size, OBSTACLE, 2.0 * _FAINT)
    for k, line in enumerate(around.outlines):
        yield _lines(now, "limits", k, strip, line, OBSTACLE, model)
    if len(around.path):
        yield _lines(now, "formation", 0, strip, around.path, OBSTACLE, model)


def array(*markers: Iterator[Marker]) -> MarkerArray:
    """All of them in one message."""
    # The library types the elements as those of ROS 2's first release.
    every: list[Any] = [marker for some in markers for marker in some]
    return MarkerArray(markers=every)


def _lines(
    now: Header, ns: str, number: int, kind: int, points: Array, colour: Colour, model: SceneModel
) -> Marker:
    """Lines through points, shape (s, 3); without any, what was drawn there is taken away."""
    size = (0.15 * model.body, 0.0, 0.0)
    drawn = _marker(now, ns, number, kind, pose_at(_ORIGIN, _NO_TURN), size, colour)
    drawn.action = Marker.ADD if len(points) else Marker.DELETE
    drawn.points = [point(one) for one in points]
    return drawn


def _marker(
    now: Header,
    ns: str,
    number: int,
    kind: int,
    pose: Pose,
    size: tuple[float, float, float],
    colour: Colour,
    opacity: float = 1.0,
    text: str = "",
) -> Marker:
    """A marker that stays until one of the same name and number takes its place."""
    x, y, z = size
    red, green, blue = (part / 255 for part in colour)
    nothing = np.zeros(0, dtype=np.uint8)
    then = Header(stamp=Time(sec=0, nanosec=0), frame_id="")
    return Marker(
        header=now,
        ns=ns,
        id=number,
        type=kind,
        action=Marker.ADD,
        pose=pose,
        scale=Vector3(x=x, y=y, z=z),
        color=ColorRGBA(r=red, g=green, b=blue, a=opacity),
        lifetime=Duration(sec=0, nanosec=0),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=Image(header=then, format="", data=nothing),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=MeshFile(filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )
