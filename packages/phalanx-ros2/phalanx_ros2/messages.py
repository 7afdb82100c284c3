"""ROS 2 messages of a swarm: poses, markers, and the diagnostics of the run and of every agent."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from phalanx_viewer.feeds import interim_outcome
from phalanx_viewer.scene.colours import COLOURS, DANGER, Role, role
from phalanx_viewer.scene.model import Poses, SceneModel, rotations_to
from phalanx_viewer.scene.picture import Kind, Shape, agent_shapes, static_shapes
from rosbags.typesys.stores import ros2_jazzy as ros
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticStatus as Status
from rosbags.typesys.stores.ros2_jazzy import geometry_msgs__msg__PoseStamped as PoseStamped
from rosbags.typesys.stores.ros2_jazzy import std_msgs__msg__Header as Header
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__Marker as Marker
from rosbags.typesys.stores.ros2_jazzy import visualization_msgs__msg__MarkerArray as MarkerArray

from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.messages.frames import AgentStatus, Frame
from phalanx.messages.step_report import QUANTITIES
from phalanx.recording.curves.series import unit_of
from phalanx.theory.arrays import Array
from phalanx_ros2 import cdr

Head = tuple[int, str]
"""Level and message of a status."""

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
_OF_OUTCOME = {
    Outcome.GUARANTEED: Status.OK,
    Outcome.SAFE: Status.WARN,
    Outcome.VIOLATED: Status.ERROR,
    Outcome.BROKEN: Status.ERROR,
    Outcome.STOPPED: Status.WARN,
}
_OF_ROLE = {
    Role.NORMAL: Status.OK,
    Role.ADVERSARY: Status.WARN,
    Role.BACKUP: Status.WARN,
    Role.NO_AUTHORITY: Status.ERROR,
    Role.SILENT: Status.STALE,
}


def pose_messages(t: float, poses: Poses) -> Iterator[PoseStamped]:
    """Each agent's pose at t [s]."""
    now = cdr.header(t, WORLD)
    for position, heading in zip(poses.positions, poses.headings, strict=True):
        yield PoseStamped(header=now, pose=pose(position, heading))


def agents(
    t: float, model: SceneModel, poses: Poses, status: Sequence[AgentStatus], unsafe: list[int]
) -> Iterator[Marker]:
    """Every agent, its name and its safety radius, coloured by its role.

    Agents of `unsafe`, the violated pairs, are red.
    """
    now, violated = cdr.header(t, WORLD), model.agents_of(unsafe)
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
    marker = _marker(cdr.header(t, WORLD), lines, model)
    marker.type = Marker.LINE_LIST
    # Without violated pairs, earlier lines are deleted.
    marker.action = Marker.ADD if ends else Marker.DELETE
    yield marker


def static_markers(t: float, model: SceneModel) -> Iterator[Marker]:
    """Obstacles, walls, limits and the formation's path."""
    now = cdr.header(t, WORLD)
    return (_marker(now, shape, model) for shape in static_shapes(model))


def array(*markers: Iterable[Marker]) -> MarkerArray:
    """Put markers into one message."""
    # The library types the elements as those of ROS 2's first release.
    every: list[Any] = [marker for some in markers for marker in some]
    return MarkerArray(markers=every)


def _marker(now: Header, shape: Shape, model: SceneModel) -> Marker:
    """Convert a shape to a marker, which stays until one of the same name and number comes."""
    x, y, z = (0.15 * model.body, 0.0, 0.0) if shape.kind is Kind.LINE else shape.size
    red, green, blue = (part / 255 for part in shape.colour)
    nothing, then = np.zeros(0, dtype=np.uint8), cdr.header(0.0, "")
    return Marker(
        header=now,
        ns=shape.group,
        id=shape.number,
        type=_TYPES[shape.kind],
        action=Marker.ADD,
        pose=pose(shape.position, shape.heading),
        scale=ros.geometry_msgs__msg__Vector3(x=x, y=y, z=z),
        color=ros.std_msgs__msg__ColorRGBA(r=red, g=green, b=blue, a=shape.opacity),
        lifetime=ros.builtin_interfaces__msg__Duration(sec=0, nanosec=0),
        frame_locked=False,
        points=[_point(one) for one in shape.points],
        colors=[],
        texture_resource="",
        texture=ros.sensor_msgs__msg__CompressedImage(header=then, format="", data=nothing),
        uv_coordinates=[],
        text=shape.text,
        mesh_resource="",
        mesh_file=ros.visualization_msgs__msg__MeshFile(filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )


def pose(position: Array, heading: Array) -> ros.geometry_msgs__msg__Pose:
    """Return a pose at a position [m] with its x-axis along a unit heading, shapes (3,)."""
    w, x, y, z = rotations_to(heading[None])[0].tolist()
    turn = ros.geometry_msgs__msg__Quaternion(x=x, y=y, z=z, w=w)
    return ros.geometry_msgs__msg__Pose(position=_point(position), orientation=turn)


def _point(position: Array) -> ros.geometry_msgs__msg__Point:
    x, y, z = position.tolist()
    return ros.geometry_msgs__msg__Point(x=x, y=y, z=z)


def diagnostics(frame: Frame, model: SceneModel, head: Head) -> Diagnostics:
    """Status of the run, with this head, then of every agent, at the frame's time."""
    figures: dict[str, object] = {
        "t [s]": frame.t,
        "h_tot": frame.h_tot,
        "worst h": frame.worst_h,
        "worst pair": model.label(frame.pair),
        "steps": frame.steps,
    }
    figures |= {a.name: f"failed since t = {a.first:.3f} s" for a in frame.assumptions if a.failed}
    statuses = [_status("run", head, model.scenario.name, figures)]
    for name, adversary, status in zip(model.names, model.adversary, frame.agents, strict=True):
        now = role(status, bool(adversary))
        figures = _figures(status, model)
        statuses.append(_status(f"agent {name}", (_OF_ROLE[now], now), name, figures))
    return Diagnostics(header=cdr.header(frame.t, WORLD), status=statuses)


def _figures(status: AgentStatus, model: SceneModel) -> dict[str, object]:
    figures: dict[str, object] = {
        "condition": status.condition,
        "backups": status.backups,
        "without authority": status.without_authority,
    }
    if step := status.step:
        for name, values in (("u", step.u), ("nominal u", step.u_nom)):
            figures[name] = ", ".join(f"{value:g}" for value in values)
        for name, quantity in QUANTITIES.items():
            unit = unit_of(quantity, model.swarm)
            figures[quantity.title.lower() + f" [{unit}]" * bool(unit)] = getattr(step, name)
    return figures


def _status(name: str, head: Head, hardware: str, figures: dict[str, object]) -> Status:
    level, message = head
    texts = {name: str(value) for name, value in figures.items() if value is not None}
    values = [ros.diagnostic_msgs__msg__KeyValue(key=k, value=v) for k, v in texts.items()]
    return Status(
        level=level, name=f"phalanx: {name}", message=message, hardware_id=hardware, values=values
    )


def interim_head(frame: Frame) -> Head:
    """Outcome of a run up to a frame."""
    outcome = interim_outcome(frame)
    pairs = ", ".join(violation.pair for violation in frame.violations)
    more = {Outcome.VIOLATED: f": {pairs}", Outcome.SAFE: ", not guaranteed"}.get(outcome, "")
    return _OF_OUTCOME[outcome], f"{outcome} so far{more}"


def last_head(summary: Summary | None, unfinished: str) -> Head:
    """Outcome of a run that is over; `unfinished` says why there is no summary."""
    if summary is None:
        return Status.ERROR, f"no verdict: {unfinished}"
    return _OF_OUTCOME[summary.outcome], f"{summary.outcome}: {summary.reason}"


def heads(message: Diagnostics) -> list[Head]:
    """Level and message of each status; only its figures change all the time."""
    return [(status.level, status.message) for status in message.status]
