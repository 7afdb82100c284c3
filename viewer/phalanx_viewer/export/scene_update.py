"""The scene in Foxglove's messages: who is where, what is around, which pair is violated."""

from collections.abc import Iterator, Sequence

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from phalanx.arrays import Array
from phalanx.theory.safety.limits import Outlined
from phalanx_viewer.scene.geometry import facing, lift
from phalanx_viewer.scene.kinematics import Poses
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.roles import COLOURS, Role

WORLD = "world"
"""The frame that stands still; every agent has one of its own, by its name."""
_SLATE, _RED = (100, 110, 125), (230, 20, 30)
_WALL = (40.0, 0.1)
"""How long and thick a wall is drawn [m]."""


def stamp(t: float) -> Timestamp:
    """A virtual time [s] as protobuf has times."""
    nanoseconds = round(t * 1e9)
    return Timestamp(seconds=nanoseconds // 1_000_000_000, nanos=nanoseconds % 1_000_000_000)


def frames(t: float, poses: Poses, names: Sequence[str]) -> tuple[FrameTransforms, PosesInFrame]:
    """Where all agents are at t [s]: as frames of their names, and as one list of poses."""
    now, transforms, listed = stamp(t), [], []
    for name, p, q in zip(names, poses.positions, facing(poses.headings), strict=True):
        turn = Quaternion(w=q[0], x=q[1], y=q[2], z=q[3])
        place = Vector3(x=p[0], y=p[1], z=p[2])
        transforms.append(
            FrameTransform(
                timestamp=now,
                parent_frame_id=WORLD,
                child_frame_id=name,
                translation=place,
                rotation=turn,
            )
        )
        listed.append(Pose(position=place, orientation=turn))
    return (
        FrameTransforms(transforms=transforms),
        PosesInFrame(timestamp=now, frame_id=WORLD, poses=listed),
    )


def opening(model: SceneModel) -> SceneUpdate:
    """Everything that is drawn once: agents move with their frames."""
    return SceneUpdate(entities=[*_agents(model), *_surroundings(model)])


def violations(t: float, ends: dict[str, tuple[Array, Array]], over: Sequence[str]) -> SceneUpdate:
    """Violated pairs at t [s] as red lines, by label, each from end to end [m]; and those over."""
    now = stamp(t)
    entities = [
        SceneEntity(
            timestamp=now,
            frame_id=WORLD,
            id=f"violated {label}",
            lines=[_line([first, second], _RED, 4.0)],
        )
        for label, (first, second) in ends.items()
    ]
    gone = [SceneEntityDeletion(timestamp=now, id=f"violated {label}") for label in over]
    return SceneUpdate(entities=entities, deletions=gone)


def _agents(model: SceneModel) -> Iterator[SceneEntity]:
    for name, adversary in zip(model.names, model.adversary, strict=True):
        colour = COLOURS[Role.ADVERSARY if adversary else Role.NORMAL]
        body, radius = model.body, model.radius
        entity = SceneEntity(
            timestamp=stamp(0.0),
            frame_id=name,
            id=name,
            frame_locked=True,
            arrows=[
                ArrowPrimitive(
                    pose=_at(-body, 0.0, 0.0),
                    shaft_length=body,
                    shaft_diameter=0.5 * body,
                    head_length=body,
                    head_diameter=body,
                    color=_colour(colour),
                )
            ],
            texts=[
                TextPrimitive(
                    pose=_at(0.0, 0.0, 1.5 * body),
                    billboard=True,
                    font_size=14.0,
                    scale_invariant=True,
                    color=_colour(colour),
                    text=name,
                )
            ],
        )
        if radius:
            size = Vector3(x=2 * radius, y=2 * radius, z=0.02 if model.flat else 2 * radius)
            faint = _colour(colour, 0.25)
            if model.flat:
                disc = CylinderPrimitive(
                    pose=_at(0.0, 0.0, 0.0), size=size, bottom_scale=1, top_scale=1, color=faint
                )
                entity.cylinders.append(disc)
            else:
                entity.spheres.append(
                    SpherePrimitive(pose=_at(0.0, 0.0, 0.0), size=size, color=faint)
                )
        yield entity


def _surroundings(model: SceneModel) -> Iterator[SceneEntity]:
    around, now = model.surroundings, stamp(0.0)
    for k, (center, radius) in enumerate(around.spheres):
        size = Vector3(x=2 * radius, y=2 * radius, z=2 * radius)
        ball = SpherePrimitive(pose=_at(*center), size=size, color=_colour(_SLATE))
        yield SceneEntity(timestamp=now, frame_id=WORLD, id=f"obstacle {k}", spheres=[ball])
    for k, (point, normal) in enumerate(around.walls):
        long, thick = _WALL
        (q,) = facing(normal[None])
        pose = _at(*(point + 0.5 * thick * normal))
        pose.orientation.CopyFrom(Quaternion(w=q[0], x=q[1], y=q[2], z=q[3]))
        size = Vector3(x=thick, y=long, z=long)
        slab = CubePrimitive(pose=pose, size=size, color=_colour(_SLATE, 0.5))
        yield SceneEntity(timestamp=now, frame_id=WORLD, id=f"wall {k}", cubes=[slab])
    for k, field in enumerate(model.scenario.limits):
        limit = field.boundary.limit
        if isinstance(limit, Outlined):
            lines = [_line([lift(np.array(p)) for p in line], _SLATE) for line in limit.outline()]
            yield SceneEntity(timestamp=now, frame_id=WORLD, id=f"limit {k}", lines=lines)
    if len(around.path):
        path = _line(list(around.path), _SLATE)
        yield SceneEntity(timestamp=now, frame_id=WORLD, id="path", lines=[path])


def _line(
    points: Sequence[Array], colour: tuple[int, int, int], thickness: float = 2.0
) -> LinePrimitive:
    """thickness: in pixels."""
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=_at(0.0, 0.0, 0.0),
        thickness=thickness,
        scale_invariant=True,
        points=[Point3(x=p[0], y=p[1], z=p[2]) for p in points],
        color=_colour(colour),
    )


def _at(x: float, y: float, z: float) -> Pose:
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=1.0))


def _colour(rgb: tuple[int, int, int], opacity: float = 1.0) -> Color:
    red, green, blue = (part / 255 for part in rgb)
    return Color(r=red, g=green, b=blue, a=opacity)
