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
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import msgspec
import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from google.protobuf.message import Message
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from phalanx.curves.quantities import unit_of
from phalanx.recording.read import Recording
from phalanx.scenario.load import to_json
from phalanx.theory.models.dynamics import Dynamics, units
from phalanx.wire.step_report import QUANTITIES, numbers_of
from phalanx_viewer.export.log import log_lines
from phalanx_viewer.export.near import near_pairs
from phalanx_viewer.export.numbers import Numbers
from phalanx_viewer.export.scene_update import frames, opening, stamp, violations
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
