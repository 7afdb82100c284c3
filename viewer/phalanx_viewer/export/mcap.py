"""A recording in Foxglove's messages, which Foxglove and other tools show and plot.

| topic | message |
|---|---|
| /tf | foxglove.FrameTransforms: every agent's frame, by its name, in "world" |
| /poses | foxglove.PosesInFrame: the same as one list, in the scenario's order |
| /scene | foxglove.SceneUpdate: agents, static geometry, violated pairs |
| /agents/<name>/state | every state by its name |
| /agents/<name>/step | u_<input> and nominal_<input>, residual, margin and so on, origin |
| /h | h_tot, and h of the pairs that were the worst one of some agent; safe is h <= 0 |
| /log | foxglove.Log |

Units are in the metadata of each channel. Times are virtual, from 0 on.
"""

import heapq
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import msgspec
import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from phalanx.curves.quantities import unit_of
from phalanx.recording.read import Recording
from phalanx.scenario.load import to_json
from phalanx.theory.models.dynamics import Dynamics, units
from phalanx.wire.step_report import QUANTITIES, numbers_of
from phalanx_viewer.export.common import log_lines, near_pairs
from phalanx_viewer.export.foxglove import frames, opening, stamp, violations
from phalanx_viewer.scene.model import SceneModel, scene_model


class TimedMessage(NamedTuple):
    """A message on its topic, at a virtual time [s]."""

    t: float
    topic: str
    message: Message
    units: Mapping[str, str] = MappingProxyType({})
    """By field."""


def write_mcap(recording: Recording, path: Path) -> None:
    """Write the whole recording. Raises OSError, ScenarioError."""
    model = scene_model(recording.scenario)
    with path.open("wb") as file:
        channels = _Channels(Writer(file))
        sources = (_moving(recording, model), _steps(recording, model), _log(recording))
        for timed in heapq.merge(*sources, key=lambda timed: timed.t):
            channels.write(timed)
        channels.finish(recording)


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

    def finish(self, recording: Recording) -> None:
        scenario = to_json(recording.scenario).encode()
        self._writer.add_metadata("phalanx", recording.metadata)
        self._writer.add_attachment(0, 0, "scenario.json", "application/json", scenario)
        if recording.summary:
            summary = msgspec.json.encode(recording.summary)
            self._writer.add_attachment(0, 0, "summary.json", "application/json", summary)
        self._writer.finish()  # type: ignore[no-untyped-call]


def _moving(recording: Recording, model: SceneModel) -> Iterator[TimedMessage]:
    """Messages about every state."""
    swarm = model.swarm
    yield TimedMessage(0.0, "/scene", opening(model))
    kinds = _kinds(recording, _state_kind)
    near, h = near_pairs(swarm, recording.x)
    labels = [model.label(pair) for pair in near]
    h_message = NumberMessage("H", ["h_tot", *(f"h_{label}" for label in labels)])
    shown = set[str]()
    for state, values in zip(recording.states, h.tolist(), strict=True):
        t, poses = state.t, model.kinematics.poses(np.array(state.x))
        transforms, listed = frames(t, poses, swarm.names)
        yield TimedMessage(t, "/tf", transforms)
        yield TimedMessage(t, "/poses", listed)
        yield TimedMessage(t, "/h", h_message([state.h_tot, *values]))
        for name, group, part in zip(swarm.names, swarm.groups, swarm.safe_set.parts, strict=True):
            kind, field_units = kinds[type(group.dynamics_object())]
            yield TimedMessage(t, f"/agents/{name}/state", kind(state.x[part]), field_units)
        violated = {
            label: model.ends(pair, poses.positions)
            for label, pair, value in zip(labels, near, values, strict=True)
            if value > 0.0
        }
        if violated or shown:
            over = sorted(shown - violated.keys())
            yield TimedMessage(t, "/scene", violations(t, violated, over))
        shown = set(violated)


def _steps(recording: Recording, model: SceneModel) -> Iterator[TimedMessage]:
    """Messages about every control step."""
    kinds = _kinds(recording, partial(_step_kind, model))
    kind_of = {n: kinds[type(g.dynamics_object())] for n, g, _ in recording.scenario.roster()}
    for step in sorted(recording.steps, key=lambda step: step.t):
        kind, field_units = kind_of[step.agent]
        nominal: Sequence[float | None] = step.u_nom or [None] * len(step.u)
        message = kind([*step.u, *nominal, *numbers_of(step)], origin=step.origin)
        yield TimedMessage(step.t, f"/agents/{step.agent}/step", message, field_units)


class NumberMessage:
    """A kind of protobuf message: a field for each of its numbers and texts, by name."""

    def __init__(self, kind: str, names: Sequence[str], texts: Sequence[str] = ()) -> None:
        """kind: the message's name, without a package."""
        self.fields = dict(zip(names, identifiers(names), strict=True))
        """Fields by the names of their numbers."""
        file = FileDescriptorProto(name=f"phalanx/{kind}.proto", package="phalanx")
        message = file.message_type.add(name=kind)
        number, text = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_STRING
        fields = [*((name, number) for name in self.fields.values()), *((t, text) for t in texts)]
        for place, (name, type_) in enumerate(fields, start=1):
            # Optional, as in proto2: a missing number is not 0.
            label = FieldDescriptorProto.LABEL_OPTIONAL
            message.field.add(name=name, number=place, type=type_, label=label)
        pool = DescriptorPool()
        pool.Add(file)
        self._make = GetMessageClass(pool.FindMessageTypeByName(f"phalanx.{kind}"))
        self._names = tuple(self.fields.values())

    def by_field(self, units: Mapping[str, str]) -> dict[str, str]:
        """Units by field instead of by name; none where they are unknown."""
        return {self.fields[name]: unit for name, unit in units.items() if unit}

    def __call__(self, values: Iterable[float | None], **texts: str) -> Message:
        """Make a message of numbers in the order of the names; None is left out."""
        given = {n: v for n, v in zip(self._names, values, strict=True) if v is not None}
        return self._make(**given, **texts)


def identifiers(names: Sequence[str]) -> list[str]:
    """Convert names to ones that protobuf accepts: letters, digits and underscores, all unique."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z]", plain) else f"n_{plain}"
        again = sum(re.fullmatch(rf"{plain}(_\d+)?", other) is not None for other in found)
        found.append(f"{plain}_{again + 1}" if plain in found else plain)
    return found


_Kind = tuple[NumberMessage, dict[str, str]]
"""A message, and the units of its fields."""


def _kinds(recording: Recording, make: Callable[[Dynamics], _Kind]) -> dict[type, _Kind]:
    """One kind of message for each class of dynamics."""
    dynamics = [group.dynamics_object() for group in recording.scenario.agents]
    return {kind: make(one) for kind, one in {type(one): one for one in dynamics}.items()}


def _state_kind(dynamics: Dynamics) -> _Kind:
    state_units = units(dynamics).states
    kind = NumberMessage(f"{type(dynamics).__name__}State", list(state_units))
    return kind, kind.by_field(state_units)


def _step_kind(model: SceneModel, dynamics: Dynamics) -> _Kind:
    inputs = units(dynamics).inputs
    field_units = {f"{side}_{i}": unit for side in ("u", "nominal") for i, unit in inputs.items()}
    field_units |= {name: unit_of(quantity, model.swarm) for name, quantity in QUANTITIES.items()}
    kind = NumberMessage(f"{type(dynamics).__name__}Step", list(field_units), texts=["origin"])
    return kind, kind.by_field(field_units)


def _log(recording: Recording) -> Iterator[TimedMessage]:
    for line in log_lines(recording):
        level, now = FoxgloveLog.Level.Value(line.level.name), stamp(line.t)
        message = FoxgloveLog(timestamp=now, level=level, message=line.text, name="phalanx")
        yield TimedMessage(line.t, "/log", message)
