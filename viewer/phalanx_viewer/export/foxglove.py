"""The scene in Foxglove's messages: agents, static geometry and violated pairs."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

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
from phalanx_viewer.scene.colours import DANGER
from phalanx_viewer.scene.kinematics import Poses, rotations_to
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.shapes import Kind, Shape, agent_shapes, static_shapes

WORLD = "world"
"""The fixed frame; every agent has one of its own, by its name."""


def stamp(t: float) -> Timestamp:
    """Convert a virtual time [s] to protobuf."""
    nanoseconds = round(t * 1e9)
    return Timestamp(seconds=nanoseconds // 1_000_000_000, nanos=nanoseconds % 1_000_000_000)


def frames(t: float, poses: Poses, names: Sequence[str]) -> tuple[FrameTransforms, PosesInFrame]:
    """Poses of all agents at t [s]: as frames of their names, and as one list."""
    now = stamp(t)
    listed = [_pose(*pose) for pose in zip(poses.positions, poses.headings, strict=True)]
    transforms = [
        FrameTransform(
            timestamp=now, parent_frame_id=WORLD, child_frame_id=name,
            translation=pose.position, rotation=pose.orientation,
        )
        for name, pose in zip(names, listed, strict=True)
    ]  # fmt: skip
    return (
        FrameTransforms(transforms=transforms),
        PosesInFrame(timestamp=now, frame_id=WORLD, poses=listed),
    )


def opening(model: SceneModel) -> SceneUpdate:
    """Everything that is drawn once: static geometry, and agents, which move with their frames."""
    return SceneUpdate(entities=[*_agents(model), *_static(model)])


def violations(
    t: float, ends: Mapping[str, tuple[Array, Array]], over: Sequence[str]
) -> SceneUpdate:
    """Draw violated pairs at t [s] as red lines, and delete those over.

    ends: of each violated pair [m], by its label.
    """
    now, entities = stamp(t), []
    for label, pair in ends.items():
        entity = SceneEntity(timestamp=now, frame_id=WORLD, id=f"violated {label}")
        entity.lines.append(_line(pair, _colour(DANGER), 4.0))
        entities.append(entity)
    deletions = [SceneEntityDeletion(timestamp=now, id=f"violated {label}") for label in over]
    return SceneUpdate(entities=entities, deletions=deletions)


def _agents(model: SceneModel) -> Iterator[SceneEntity]:
    for i, name in enumerate(model.names):
        entity = SceneEntity(timestamp=stamp(0.0), frame_id=name, id=name, frame_locked=True)
        for shape in agent_shapes(model, i, model.first_colour(i)):
            _add(entity, shape)
        yield entity


def _static(model: SceneModel) -> Iterator[SceneEntity]:
    for shape in static_shapes(model):
        number = "" if shape.group == "path" else f" {shape.number}"
        entity = SceneEntity(timestamp=stamp(0.0), frame_id=WORLD, id=f"{shape.group}{number}")
        _add(entity, shape)
        yield entity


def _add(entity: SceneEntity, shape: Shape) -> None:
    """Add a shape to an entity."""
    colour, pose = _colour(shape.colour, shape.opacity), _pose(shape.place, shape.heading)
    x, y, z = shape.size
    size = Vector3(x=x, y=y, z=z)
    match shape.kind:
        case Kind.ARROW:
            arrow = ArrowPrimitive(
                pose=pose, shaft_length=x / 2.0, shaft_diameter=y / 2.0, head_length=x / 2.0,
                head_diameter=y, color=colour,
            )  # fmt: skip
            entity.arrows.append(arrow)
        case Kind.TEXT:
            text = TextPrimitive(
                pose=pose, billboard=True, font_size=14.0, scale_invariant=True, color=colour,
                text=shape.text,
            )  # fmt: skip
            entity.texts.append(text)
        case Kind.BALL:
            entity.spheres.append(SpherePrimitive(pose=pose, size=size, color=colour))
        case Kind.DISC:
            disc = CylinderPrimitive(
                pose=pose, size=size, bottom_scale=1, top_scale=1, color=colour
            )
            entity.cylinders.append(disc)
        case Kind.BOX:
            entity.cubes.append(CubePrimitive(pose=pose, size=size, color=colour))
        case Kind.LINE:
            entity.lines.append(_line(shape.points, colour, 2.0))


def _line(points: Iterable[Array], colour: Color, thickness: float) -> LinePrimitive:
    """thickness: in pixels."""
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=Pose(orientation=Quaternion(w=1.0)),
        thickness=thickness,
        scale_invariant=True,
        points=[Point3(x=p[0], y=p[1], z=p[2]) for p in points],
        color=colour,
    )


def _pose(place: Array, heading: Array) -> Pose:
    x, y, z = place
    ((w, a, b, c),) = rotations_to(heading[None])
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=w, x=a, y=b, z=c))


def _colour(rgb: tuple[int, int, int], opacity: float = 1.0) -> Color:
    red, green, blue = (part / 255 for part in rgb)
    return Color(r=red, g=green, b=blue, a=opacity)
