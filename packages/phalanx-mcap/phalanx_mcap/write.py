"""A recording in Foxglove's messages, which Foxglove and other tools show and plot.

| topic | message |
|---|---|
| /tf | foxglove.FrameTransforms: every agent's frame, by its name, in "world" |
| /poses | foxglove.PosesInFrame: the same as one list, in the scenario's order |
| /scene | foxglove.SceneUpdate: agents, static geometry, violated pairs |
| /agents/<name>/state | every state by its name |
| /agents/<name>/step | u_<input> and nominal_<input>, residual, margin and so on, origin |
| /h | h_tot, and h of the pairs that were the worst one of some agent; safe is h <= 0 |
| /agents/<name>/beliefs | foxglove.SceneUpdate: where peers by radio can be; up to 24 agents |
| /agents/<name>/ages | ages of what it knew of each peer by radio [s] |
| /log | foxglove.Log |

Units are in the metadata of each channel. Times are virtual, from 0 on.
"""

import heapq
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import msgspec
import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
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
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema
from phalanx_viewer.scene.colours import DANGER
from phalanx_viewer.scene.ghosts import belief_shapes
from phalanx_viewer.scene.model import Poses, SceneModel, rotations_to
from phalanx_viewer.scene.picture import Kind, Shape, agent_shapes, static_shapes

from phalanx.native.files import whole_file
from phalanx.recording.curves.beliefs import Beliefs
from phalanx.recording.read import Recording
from phalanx.scenario.model import to_json
from phalanx.theory.arrays import Array
from phalanx_mcap.content import Content, Numbers

WORLD = "world"
"""The fixed frame; every agent has one of its own, by its name."""
_BELIEFS_PERIOD = 0.1
"""Least time between two messages with an agent's beliefs [s]."""


class TimedMessage(NamedTuple):
    """A message on its topic, at a virtual time [s]."""

    t: float
    topic: str
    message: Message
    units: Mapping[str, str] = MappingProxyType({})
    """By field."""


def write_mcap(recording: Recording, model: SceneModel, path: Path) -> None:
    """Write the whole recording. Raises OSError."""
    content = Content(recording, model)
    with whole_file(path) as part, part.open("wb") as file:
        channels = _Channels(Writer(file))
        sources = [_moving(content), *map(_messages, content.numbers()), _log(content)]
        if content.radio and not content.model.crowded:
            sources += [_beliefs(content, content.radio, i) for i in content.radio.news]
        for timed in heapq.merge(*sources, key=lambda timed: timed.t):
            channels.write(timed)
        channels.finish(content)


class _Channels:
    """One channel for each topic, registered with its first message."""

    def __init__(self, writer: Writer) -> None:
        self._writer, self._numbers = writer, dict[str, int]()
        self._schemas: dict[type[Message], int] = {}
        writer.start(profile="", library=f"phalanx {version('phalanx-swarm')}")

    def write(self, timed: TimedMessage) -> None:
        if timed.topic not in self._numbers:
            kind = type(timed.message)
            if kind not in self._schemas:
                self._schemas[kind] = register_schema(self._writer, kind)
            self._numbers[timed.topic] = self._writer.register_channel(
                timed.topic, "protobuf", self._schemas[kind], dict(timed.units)
            )
        at = round(timed.t * 1e9)
        number, data = self._numbers[timed.topic], timed.message.SerializeToString()
        self._writer.add_message(number, log_time=at, publish_time=at, data=data)

    def finish(self, content: Content) -> None:
        recording = content.recording
        scenario = to_json(recording.scenario).encode()
        self._writer.add_metadata("phalanx", recording.metadata)
        self._writer.add_attachment(0, 0, "scenario.json", "application/json", scenario)
        if recording.summary:
            summary = msgspec.json.encode(recording.summary)
            self._writer.add_attachment(0, 0, "summary.json", "application/json", summary)
        self._writer.finish()  # type: ignore[no-untyped-call]


def _moving(content: Content) -> Iterator[TimedMessage]:
    """Messages about every state: poses and violated pairs."""
    yield TimedMessage(0.0, "/scene", opening(content.model))
    times = content.recording.times.tolist()
    for t, poses, (ends, over) in zip(times, content.poses, content.violated(), strict=True):
        transforms, listed = frames(t, poses, content.model.names)
        yield TimedMessage(t, "/tf", transforms)
        yield TimedMessage(t, "/poses", listed)
        if ends or over:
            yield TimedMessage(t, "/scene", violations(t, ends, over))


def _messages(numbers: Numbers) -> Iterator[TimedMessage]:
    """A message for each time."""
    names, texts = tuple(numbers.values), ("origin",) if numbers.origins else ()
    kind, fields = number_message(numbers.kind, names, texts)
    units = [numbers.units.get(name, "") for name in names]
    field_units = {field: unit for field, unit in zip(fields, units, strict=True) if unit}
    rows = np.array(list(numbers.values.values())).T
    for k in np.argsort(numbers.t, kind="stable").tolist():
        values = zip(fields, rows[k].tolist(), strict=True)
        arguments: dict[str, float | str] = {f: value for f, value in values if not np.isnan(value)}
        if numbers.origins:
            arguments["origin"] = numbers.origins[k]
        yield TimedMessage(float(numbers.t[k]), f"/{numbers.topic}", kind(**arguments), field_units)


@cache
def number_message(
    name: str, numbers: tuple[str, ...], texts: tuple[str, ...]
) -> tuple[type[Message], list[str]]:
    """Make a kind of protobuf message, without a package, and the fields of its numbers."""
    fields = identifiers(numbers)
    file = FileDescriptorProto(name=f"phalanx/{name}.proto", package="phalanx")
    message = file.message_type.add(name=name)
    number, text = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_STRING
    kinds = [*((field, number) for field in fields), *((field, text) for field in texts)]
    for tag, (field, kind) in enumerate(kinds, start=1):
        # Optional, as in proto2: a missing number is not 0.
        label = FieldDescriptorProto.LABEL_OPTIONAL
        message.field.add(name=field, number=tag, type=kind, label=label)
    pool = DescriptorPool()
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(f"phalanx.{name}")), fields


def identifiers(names: Iterable[str]) -> list[str]:
    """Convert names to ones that protobuf accepts: letters, digits and underscores, all unique."""
    fields: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z]", plain) else f"n_{plain}"
        again = sum(re.fullmatch(rf"{plain}(_\d+)?", other) is not None for other in fields)
        fields.append(f"{plain}_{again + 1}" if plain in fields else plain)
    return fields


def _beliefs(content: Content, radio: Beliefs, i: int) -> Iterator[TimedMessage]:
    """Draw the beliefs of agent i a few times a second, on a topic that can be hidden."""
    topic, due = f"/agents/{content.model.names[i]}/beliefs", 0.0
    for t in radio.sampled[i]:
        if t >= due:
            due = t + _BELIEFS_PERIOD
            entity = SceneEntity(timestamp=stamp(t), frame_id=WORLD, id=topic)
            for shape in belief_shapes(radio.at(i, t)):
                _add(entity, shape)
            yield TimedMessage(t, topic, SceneUpdate(entities=[entity]))


def _log(content: Content) -> Iterator[TimedMessage]:
    for line in content.log():
        level, now = FoxgloveLog.Level.Value(line.level.name), stamp(line.t)
        message = FoxgloveLog(timestamp=now, level=level, message=line.text, name="phalanx")
        yield TimedMessage(line.t, "/log", message)


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
    update, now = SceneUpdate(), stamp(0.0)
    for i, name in enumerate(model.names):
        entity = update.entities.add(timestamp=now, frame_id=name, id=name, frame_locked=True)
        for shape in agent_shapes(model, i, model.first_colour(i)):
            _add(entity, shape)
    for shape in static_shapes(model):
        number = "" if shape.group == "path" else f" {shape.number}"
        _add(update.entities.add(timestamp=now, frame_id=WORLD, id=shape.group + number), shape)
    return update


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


def _add(entity: SceneEntity, shape: Shape) -> None:
    """Add a shape to an entity."""
    colour, pose = _colour(shape.colour, shape.opacity), _pose(shape.position, shape.heading)
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


def _pose(position: Array, heading: Array) -> Pose:
    x, y, z = position
    ((w, a, b, c),) = rotations_to(heading[None])
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(w=w, x=a, y=b, z=c))


def _colour(rgb: tuple[int, int, int], opacity: float = 1.0) -> Color:
    red, green, blue = (part / 255 for part in rgb)
    return Color(r=red, g=green, b=blue, a=opacity)
