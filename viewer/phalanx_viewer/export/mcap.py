"""A recording in Foxglove's messages, so that Foxglove and others show and plot it.

| topic | message |
|---|---|
| /tf | foxglove.FrameTransforms: every agent's frame, by its name, in "world" |
| /poses | foxglove.PosesInFrame: the same as one list, in the scenario's order |
| /scene | foxglove.SceneUpdate: agents, surroundings, violated pairs |
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
from phalanx_viewer.export.foxglove import frames, opening, stamp, violations
from phalanx_viewer.export.shown import log_lines, near_pairs
from phalanx_viewer.scene.model import SceneModel, scene_model


class Topical(NamedTuple):
    """A message on its topic, at a virtual time [s]."""

    t: float
    topic: str
    message: Message
    units: Mapping[str, str] = MappingProxyType({})
    """By field."""


def write_mcap(recording: Recording, path: Path) -> None:
    """Write the whole recording. Raises OSError, and ScenarioError as building its swarm does."""
    model = scene_model(recording.scenario)
    with path.open("wb") as file:
        channels = _Channels(Writer(file))
        sources = (_moving(recording, model), _steps(recording, model), _log(recording))
        for topical in heapq.merge(*sources, key=lambda topical: topical.t):
            channels.write(topical)
        channels.finish(recording)


class _Channels:
    """One channel for each topic, registered with its first message."""

    def __init__(self, writer: Writer) -> None:
        self._writer, self._numbers = writer, dict[str, int]()
        self._schemas: dict[type[Message], int] = {}
        writer.start(profile="", library=f"phalanx {version('phalanx-swarm')}")

    def write(self, topical: Topical) -> None:
        if topical.topic not in self._numbers:
            kind = type(topical.message)
            if kind not in self._schemas:
                self._schemas[kind] = register_schema(self._writer, kind)
            self._numbers[topical.topic] = self._writer.register_channel(
                topical.topic, "protobuf", self._schemas[kind], dict(topical.units)
            )
        at = round(topical.t * 1e9)
        number, data = self._numbers[topical.topic], topical.message.SerializeToString()
        self._writer.add_message(number, log_time=at, publish_time=at, data=data)

    def finish(self, recording: Recording) -> None:
        scenario = to_json(recording.scenario).encode()
        self._writer.add_metadata("phalanx", recording.metadata)
        self._writer.add_attachment(0, 0, "scenario.json", "application/json", scenario)
        if recording.summary:
            summary = msgspec.json.encode(recording.summary)
            self._writer.add_attachment(0, 0, "summary.json", "application/json", summary)
        self._writer.finish()  # type: ignore[no-untyped-call]


def _moving(recording: Recording, model: SceneModel) -> Iterator[Topical]:
    """What there is of every state."""
    swarm = model.swarm
    yield Topical(0.0, "/scene", opening(model))
    kinds = _kinds(recording, _state_kind)
    near, h = near_pairs(swarm, recording.x)
    labels = [model.label(pair) for pair in near]
    of_pairs, shown = Numbers("H", ["h_tot", *(f"h_{label}" for label in labels)]), set[str]()
    for state, values in zip(recording.states, h.tolist(), strict=True):
        t, poses = state.t, model.kinematics.poses(np.array(state.x))
        transforms, listed = frames(t, poses, swarm.names)
        yield Topical(t, "/tf", transforms)
        yield Topical(t, "/poses", listed)
        yield Topical(t, "/h", of_pairs([state.h_tot, *values]))
        for name, group, part in zip(swarm.names, swarm.groups, swarm.safe_set.parts, strict=True):
            kind, of_field = kinds[type(group.dynamics_object())]
            yield Topical(t, f"/agents/{name}/state", kind(state.x[part]), of_field)
        violated = {
            label: model.ends(pair, poses.positions)
            for label, pair, value in zip(labels, near, values, strict=True)
            if value > 0.0
        }
        if violated or shown:
            yield Topical(t, "/scene", violations(t, violated, sorted(shown - violated.keys())))
        shown = set(violated)


def _steps(recording: Recording, model: SceneModel) -> Iterator[Topical]:
    """Every control step."""
    kinds = _kinds(recording, partial(_step_kind, model))
    of_agent = {n: kinds[type(g.dynamics_object())] for n, g, _ in recording.scenario.roster()}
    for step in sorted(recording.steps, key=lambda step: step.t):
        kind, of_field = of_agent[step.agent]
        nominal: Sequence[float | None] = step.u_nom or [None] * len(step.u)
        message = kind([*step.u, *nominal, *numbers_of(step)], origin=step.origin)
        yield Topical(step.t, f"/agents/{step.agent}/step", message, of_field)


class Numbers:
    """A kind of protobuf message: a field for each name of a number, and perhaps some of text."""

    def __init__(self, kind: str, names: Sequence[str], texts: Sequence[str] = ()) -> None:
        """kind: the message's name, without a package."""
        self.fields = dict(zip(names, identifiers(names), strict=True))
        """The field's name by what it holds."""
        file = FileDescriptorProto(name=f"phalanx/{kind}.proto", package="phalanx")
        message = file.message_type.add(name=kind)
        number, text = FieldDescriptorProto.TYPE_DOUBLE, FieldDescriptorProto.TYPE_STRING
        fields = [*((name, number) for name in self.fields.values()), *((t, text) for t in texts)]
        for place, (name, type_) in enumerate(fields, start=1):
            # Optional, as proto2 has it: a number that is not there is not 0.
            label = FieldDescriptorProto.LABEL_OPTIONAL
            message.field.add(name=name, number=place, type=type_, label=label)
        pool = DescriptorPool()
        pool.Add(file)
        self._make = GetMessageClass(pool.FindMessageTypeByName(f"phalanx.{kind}"))
        self._names = tuple(self.fields.values())

    def by_field(self, units: Mapping[str, str]) -> dict[str, str]:
        """Units by field instead of by name; none where they are not known."""
        return {self.fields[name]: unit for name, unit in units.items() if unit}

    def __call__(self, values: Iterable[float | None], **texts: str) -> Message:
        """A message of numbers in the order of the names; None is left out."""
        given = {n: v for n, v in zip(self._names, values, strict=True) if v is not None}
        return self._make(**given, **texts)


def identifiers(names: Sequence[str]) -> list[str]:
    """Names that protobuf takes, all different: letters, digits and underscores."""
    found: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z]", plain) else f"n_{plain}"
        again = sum(re.fullmatch(rf"{plain}(_\d+)?", other) is not None for other in found)
        found.append(f"{plain}_{again + 1}" if plain in found else plain)
    return found


_Kind = tuple[Numbers, dict[str, str]]
"""A message, and the units of its fields."""


def _kinds(recording: Recording, make: Callable[[Dynamics], _Kind]) -> dict[type, _Kind]:
    """One kind of message for each class of dynamics."""
    dynamics = [group.dynamics_object() for group in recording.scenario.agents]
    return {kind: make(one) for kind, one in {type(one): one for one in dynamics}.items()}


def _state_kind(dynamics: Dynamics) -> _Kind:
    of_state = units(dynamics).states
    kind = Numbers(f"{type(dynamics).__name__}State", list(of_state))
    return kind, kind.by_field(of_state)


def _step_kind(model: SceneModel, dynamics: Dynamics) -> _Kind:
    inputs = units(dynamics).inputs
    of_field = {f"{side}_{i}": unit for side in ("u", "nominal") for i, unit in inputs.items()}
    of_field |= {name: unit_of(quantity, model.swarm) for name, quantity in QUANTITIES.items()}
    kind = Numbers(f"{type(dynamics).__name__}Step", list(of_field), texts=["origin"])
    return kind, kind.by_field(of_field)


def _log(recording: Recording) -> Iterator[Topical]:
    """Every line of the log."""
    for line in log_lines(recording):
        level = FoxgloveLog.Level.Value(line.level.name)
        told = FoxgloveLog(timestamp=stamp(line.t), level=level, message=line.text, name="phalanx")
        yield Topical(line.t, "/log", told)
