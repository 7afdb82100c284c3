"""A recording for rerun's viewer: the scene, the plots and the log, arranged.

| entity | what is logged |
|---|---|
| /world/agents/<name> | Transform3D at every state; an arrow with its name, a disc or ball |
| /world/obstacles, /world/limits, /world/path | static geometry |
| /world/violated | pairs with h > 0 as lines, while they last |
| /h | Scalars: h_tot, and h of the pairs that were the worst one of some agent |
| /agents/<name>/state/<state> | Scalars |
| /agents/<name>/step/<field> | Scalars: u_<input>, nominal_<input>, residual, margin and so on |
| /log | TextLog |

The timeline t is virtual, from 0 on.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from phalanx.arrays import Array
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Level, Step
from phalanx.wire.step_report import QUANTITIES
from phalanx_viewer.export.common import log_lines, near_pairs
from phalanx_viewer.scene.colours import DANGER
from phalanx_viewer.scene.kinematics import rotations_to
from phalanx_viewer.scene.model import SceneModel, scene_model
from phalanx_viewer.scene.shapes import Kind, Shape, agent_shapes, static_shapes

_TIMELINE = "t"
_LEVELS = {Level.INFO: "INFO", Level.WARNING: "WARN", Level.ERROR: "ERROR"}
"""rerun's names of levels, by which it colours them."""


def write_rerun(recording: Recording, path: Path) -> None:
    """Write the whole recording. Raises OSError, ScenarioError."""
    model = scene_model(recording.scenario)
    stream = rr.RecordingStream(f"phalanx {recording.scenario.name}")
    stream.save(path, default_blueprint=_blueprint(model))
    _log_static(stream, model)
    _log_states(stream, recording, model)
    for name, steps in steps_by_agent(recording).items():
        _log_steps(stream, name, steps, model)
    for line in log_lines(recording):
        stream.set_time(_TIMELINE, duration=_nanoseconds(line.t))
        stream.log("log", rr.TextLog(line.text, level=_LEVELS[line.level]))
    stream.flush()
    stream.disconnect()


def _blueprint(model: SceneModel) -> rrb.Blueprint:
    """Arrange views: the scene left of h, certified times and residuals, above the log."""
    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="h", name="h: safe is at most 0"),
        rrb.TimeSeriesView(name="certified [s]", contents=_agent_paths(model, "certified")),
        rrb.TimeSeriesView(name="residual", contents=_agent_paths(model, "residual")),
    )
    scene = rrb.Spatial3DView(origin="world", name=model.scenario.name)
    top = rrb.Horizontal(scene, plots, column_shares=[3, 2])
    return rrb.Blueprint(
        rrb.Vertical(top, rrb.TextLogView(origin="log", name="log"), row_shares=[4, 1]),
        rrb.TimePanel(timeline=_TIMELINE, state="collapsed"),
        collapse_panels=True,
    )


def _agent_paths(model: SceneModel, field: str) -> list[str]:
    normal = [model.names[i] for i in model.swarm.normal]
    return [f"/agents/{name}/step/{field}" for name in normal]


def _log_static(stream: rr.RecordingStream, model: SceneModel) -> None:
    """Log static geometry, and the shapes that move with each agent's frame."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for shape in static_shapes(model):
        entity = "path" if shape.group == "path" else f"{shape.group}s/{shape.number}"
        stream.log(f"world/{entity}", _archetype(shape), static=True)
    for i, name in enumerate(model.names):
        arrow, _, *reach = agent_shapes(model, i, model.first_colour(i))
        stream.log(f"world/agents/{name}/body", _archetype(arrow, [name]), static=True)
        for shape in reach:
            stream.log(f"world/agents/{name}/radius", _archetype(shape), static=True)


def _archetype(shape: Shape, labels: Sequence[str] | None = None) -> rr.AsComponents:
    """Convert a shape to rerun's; `labels` are an arrow's."""
    colours = [(*shape.colour, round(255 * shape.opacity))]
    if shape.kind is Kind.LINE:
        return rr.LineStrips3D([shape.points], colors=colours)
    long, wide, _ = shape.size
    if shape.kind is Kind.ARROW:
        return rr.Arrows3D(
            origins=[shape.place], vectors=[long * shape.heading], radii=[0.25 * wide],
            colors=colours, labels=labels,
        )  # fmt: skip
    half = [side / 2.0 for side in shape.size]
    solid = "solid" if shape.group != "safety radius" else None
    looks = {"centers": [shape.place], "half_sizes": [half], "colors": colours, "fill_mode": solid}
    if shape.kind is not Kind.BOX:
        return rr.Ellipsoids3D(**looks)
    turn = np.roll(rotations_to(shape.heading[None])[0], -1)
    return rr.Boxes3D(**looks, quaternions=[rr.Quaternion(xyzw=turn)])


def _log_states(stream: rr.RecordingStream, recording: Recording, model: SceneModel) -> None:
    """Log every agent's pose and states, and h."""
    if not recording.states:
        return
    swarm, x, times = model.swarm, recording.x, [_at(recording.times)]
    poses = [model.kinematics.poses(state) for state in x]
    positions = np.array([p.positions for p in poses])
    turns = np.array([np.roll(rotations_to(p.headings), -1, axis=1) for p in poses])
    for i, (member, part) in enumerate(zip(swarm.members, swarm.safe_set.parts, strict=True)):
        moved = rr.Transform3D.columns(translation=positions[:, i], quaternion=turns[:, i])
        stream.send_columns(f"world/agents/{member.name}", times, moved)
        for name, values in zip(member.dynamics.states, x[:, part].T, strict=True):
            _plot(stream, f"agents/{member.name}/state/{name}", recording.times, values)
    near, h = near_pairs(swarm, x)
    _plot(stream, "h/h_tot", recording.times, recording.h_tot)
    for pair, values in zip(near, h.T, strict=True):
        _plot(stream, f"h/{model.label(pair).replace(' ', '_')}", recording.times, values)
    for t, lines in _violated(recording, model, near, h, positions):
        stream.set_time(_TIMELINE, duration=_nanoseconds(t))
        stream.log("world/violated", rr.LineStrips3D(lines, colors=[DANGER]))


def _violated(
    recording: Recording, model: SceneModel, near: Sequence[int], h: Array, positions: Array
) -> Iterator[tuple[float, list[Array]]]:
    """Violated pairs as lines, at each state that has or ends any."""
    drawn = False
    for t, values, at in zip(recording.times, h, positions, strict=True):
        unsafe = np.flatnonzero(~(values <= 0.0))
        if len(unsafe) or drawn:
            yield float(t), [np.stack(model.ends(near[k], at)) for k in unsafe.tolist()]
        drawn = bool(len(unsafe))


def _log_steps(
    stream: rr.RecordingStream, name: str, steps: Sequence[Step], model: SceneModel
) -> None:
    """Log one agent's control steps."""
    t = np.array([step.t for step in steps])
    inputs = model.swarm.members[model.names.index(name)].dynamics.inputs
    for k, input_name in enumerate(inputs):
        _plot(stream, f"agents/{name}/step/u_{input_name}", t, [s.u[k] for s in steps])
        nominal = [s.u_nom[k] if s.u_nom else None for s in steps]
        _plot(stream, f"agents/{name}/step/nominal_{input_name}", t, nominal)
    for field in QUANTITIES:
        _plot(stream, f"agents/{name}/step/{field}", t, [getattr(s, field) for s in steps])


def _plot(
    stream: rr.RecordingStream, entity: str, t: Array, values: Sequence[float | None] | Array
) -> None:
    """Log values at times [s]; unknown ones are left out."""
    y = np.array(values, dtype=float)
    known = np.isfinite(y)
    if known.any():
        columns = rr.Scalars.columns(scalars=y[known])
        stream.send_columns(entity, [_at(t[known])], columns)


def _at(t: Array) -> rr.TimeColumn:
    return rr.TimeColumn(_TIMELINE, duration=_nanoseconds(t))


def _nanoseconds(t: Array | float) -> Any:
    """Convert times [s] for rerun, rounded to nanoseconds, which it would truncate."""
    return np.round(1e9 * np.asarray(t)).astype("timedelta64[ns]")
