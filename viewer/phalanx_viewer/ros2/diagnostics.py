"""Status of the run and of every agent, as the DiagnosticArray that ROS 2's monitors show."""

from collections.abc import Sequence

from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticArray as Diagnostics
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__DiagnosticStatus as Status
from rosbags.typesys.stores.ros2_jazzy import diagnostic_msgs__msg__KeyValue as KeyValue

from phalanx.curves.quantities import unit_of
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.wire.messages import AgentStatus, Frame
from phalanx.wire.step_report import QUANTITIES, AppliedStep
from phalanx_viewer.ros2.messages import header
from phalanx_viewer.scene.colours import Role, role
from phalanx_viewer.scene.model import SceneModel

Head = tuple[int, str]
"""Level and message of a status."""

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


def diagnostics(frame: Frame, model: SceneModel, head: Head) -> Diagnostics:
    """Status of the run, with this head, then of every agent, at the frame's time."""
    each = zip(model.names, model.adversary, frame.agents, strict=True)
    agents = [_agent(name, bool(adversary), status, model) for name, adversary, status in each]
    return Diagnostics(header=header(frame.t), status=[_run(frame, model, head), *agents])


def interim_outcome(frame: Frame) -> Head:
    """Outcome of a live run up to a frame."""
    if frame.violations:
        pairs = ", ".join(violation.pair for violation in frame.violations)
        return Status.ERROR, f"violated: {pairs}"
    return Status.OK, "no pair left the safe set so far"


def outcome(summary: Summary | None) -> Head:
    """Outcome of a run that is over; None: its plant was killed."""
    if summary is None:
        return Status.ERROR, "the plant left without a verdict"
    return _OF_OUTCOME[summary.outcome], f"{summary.outcome}: {summary.reason}"


def heads(found: Diagnostics) -> list[Head]:
    """Level and message of each status; only its figures change all the time."""
    return [(status.level, status.message) for status in found.status]


def _run(frame: Frame, model: SceneModel, head: Head) -> Status:
    figures = {
        "t [s]": frame.t,
        "h_tot": frame.h_tot,
        "worst h_tot": frame.worst_h,
        "worst pair": model.label(frame.pair),
        "steps": frame.steps,
    }
    figures |= {a.name: f"failed since t = {a.first:.3f} s" for a in frame.assumptions if a.failed}
    return _status("run", head, model.scenario.name, figures)


def _agent(name: str, adversary: bool, status: AgentStatus, model: SceneModel) -> Status:
    found = role(status, adversary)
    figures: dict[str, object] = {
        "condition": status.condition,
        "backups": status.backups,
        "without authority": status.without_authority,
    }
    figures |= _figures_of(status.step, model) if status.step else {}
    return _status(f"agent {name}", (_OF_ROLE[found], found), name, figures)


def _figures_of(step: AppliedStep, model: SceneModel) -> dict[str, object]:
    found: dict[str, object] = {"u": _listed(step.u), "nominal u": _listed(step.u_nom)}
    for name, quantity in QUANTITIES.items():
        unit = unit_of(quantity, model.swarm)
        found[quantity.title.lower() + f" [{unit}]" * bool(unit)] = getattr(step, name)
    return found


def _status(name: str, head: Head, hardware: str, figures: dict[str, object]) -> Status:
    level, message = head
    values = [KeyValue(key=k, value=str(v)) for k, v in figures.items() if v is not None]
    return Status(
        level=level, name=f"phalanx: {name}", message=message, hardware_id=hardware, values=values
    )


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{value:g}" for value in values)
