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

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from phalanx.files import whole_file
from phalanx.recording.records import Level
from phalanx.theory.arrays import Array
from phalanx_viewer.export.common import Content, Numbers
from phalanx_viewer.scene.colours import DANGER
from phalanx_viewer.scene.model import SceneModel, rotations_to
from phalanx_viewer.scene.picture import Kind, Shape, agent_shapes, static_shapes

_TIMELINE = "t"
_LEVELS = {Level.INFO: "INFO", Level.WARNING: "WARN", Level.ERROR: "ERROR"}
"""rerun's names of levels, by which it colours them."""


def write_rerun(content: Content, path: Path) -> None:
    """Write the whole recording. Raises OSError."""
    model = content.model
    stream = rr.RecordingStream(f"phalanx {model.scenario.name}")
    with whole_file(path) as part:
        stream.save(part, default_blueprint=_blueprint(model))
        _log_static(stream, model)
        _log_moving(stream, content)
        for numbers in content.numbers():
            _plot(stream, numbers)
        for line in content.log():
            stream.set_time(_TIMELINE, duration=_nanoseconds(line.t))
            stream.log("log", rr.TextLog(line.text, level=_LEVELS[line.level]))
        stream.flush()
        stream.disconnect()


def _blueprint(model: SceneModel) -> rrb.Blueprint:
    """Arrange views: the scene left of h, certified times and residuals, above the log."""

    def of_normal(number: str) -> list[str]:
        return [f"/agents/{model.names[i]}/step/{number}" for i in model.swarm.normal]

    plots = rrb.Vertical(
        rrb.TimeSeriesView(origin="h", name="h: safe is at most 0"),
        rrb.TimeSeriesView(name="certified [s]", contents=of_normal("certified")),
        rrb.TimeSeriesView(name="residual", contents=of_normal("residual")),
    )
    scene = rrb.Spatial3DView(origin="world", name=model.scenario.name)
    top = rrb.Horizontal(scene, plots, column_shares=[3, 2])
    return rrb.Blueprint(
        rrb.Vertical(top, rrb.TextLogView(origin="log", name="log"), row_shares=[4, 1]),
        rrb.TimePanel(timeline=_TIMELINE, state="collapsed"),
        collapse_panels=True,
    )


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
            origins=[shape.position], vectors=[long * shape.heading], radii=[0.25 * wide],
            colors=colours, labels=labels,
        )  # fmt: skip
    half = [side / 2.0 for side in shape.size]
    solid = "solid" if shape.group != "safety radius" else None
    looks = {
        "centers": [shape.position],
        "half_sizes": [half],
        "colors": colours,
        "fill_mode": solid,
    }
    if shape.kind is not Kind.BOX:
        return rr.Ellipsoids3D(**looks)
    turn = np.roll(rotations_to(shape.heading[None])[0], -1)
    return rr.Boxes3D(**looks, quaternions=[rr.Quaternion(xyzw=turn)])


def _log_moving(stream: rr.RecordingStream, content: Content) -> None:
    """Log every agent's pose, and violated pairs as lines at each state that has or ends any."""
    times = content.recording.times
    positions = np.array([poses.positions for poses in content.poses])
    turns = np.array([np.roll(rotations_to(p.headings), -1, axis=1) for p in content.poses])
    for i, name in enumerate(content.model.names):
        moved = rr.Transform3D.columns(translation=positions[:, i], quaternion=turns[:, i])
        stream.send_columns(f"world/agents/{name}", [_at(times)], moved)
    for t, (ends, over) in zip(times, content.violated(), strict=True):
        if ends or over:
            stream.set_time(_TIMELINE, duration=_nanoseconds(t))
            lines = [np.stack(pair) for pair in ends.values()]
            stream.log("world/violated", rr.LineStrips3D(lines, colors=[DANGER]))


def _plot(stream: rr.RecordingStream, numbers: Numbers) -> None:
    """Log each number over time; where it is unknown it is left out."""
    for name, values in numbers.values.items():
        finite = np.isfinite(values)
        if numbers.topic == "h" and name != "h_tot":
            name = name.removeprefix("h_").replace(" ", "_")
        if finite.any():
            columns = rr.Scalars.columns(scalars=values[finite])
            stream.send_columns(f"{numbers.topic}/{name}", [_at(numbers.t[finite])], columns)


def _at(t: Array) -> rr.TimeColumn:
    return rr.TimeColumn(_TIMELINE, duration=_nanoseconds(t))


def _nanoseconds(t: Array | float) -> Any:
    """Convert times [s] for rerun, rounded to nanoseconds, which it would truncate."""
    return np.round(1e9 * np.asarray(t)).astype("timedelta64[ns]")
