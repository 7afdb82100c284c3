"""The metrics of a run, of each agent and of the swarm: as numbers, data frame and text."""

from collections.abc import Callable, Mapping, Sequence
from numbers import Real
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeVar

from phalanx.recording.columns import Track
from phalanx.recording.metrics.measures import (
    Thresholds,
    Value,
    metrics_of_agents,
    track_of,
)
from phalanx.recording.read import Recording, swarm_of
from phalanx.schema.extensions import extras_named
from phalanx.swarm.swarm import Swarm

if TYPE_CHECKING:
    import polars as pl

SWARM = "swarm"
"""The agent and the role of the swarm's row."""
_OF_ROW = ("run", "scenario", "seed", "agent", "role")
"""The columns that say of what a row is."""


class Metric(NamedTuple):
    """A number of each agent, and how those of all normal agents become one of the swarm."""

    unit: str
    meaning: str
    of_swarm: Callable[[Sequence[Any]], float | bool]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values)


METRICS: Mapping[str, Metric] = {
    "tracking_error_mean": Metric("m", "distance from the goal, mean over the time", _mean),
    "tracking_error_final": Metric("m", "distance from the goal at the end", max),
    "distance_to_goal": Metric("m", "distance at the end from where the goal comes to rest", max),
    "arrived": Metric("", "at the end within reach of where the goal comes to rest", all),
    "arrival_time": Metric("s", "since when it has been there", max),
    "deadlock_time": Metric("s", "time that it stood though it wanted to move", sum),
    "deadlock_share": Metric("", "the same as a share of the run", _mean),
    "deadlock_since": Metric("s", "since when it first did", min),
    "input_deviation_mean": Metric("of u", "‖u - u_nom‖, mean over the time", _mean),
    "input_energy": Metric("of u², s", "∫ ‖u‖² dt", sum),
    "backup_time": Metric("s", "time on the backup", sum),
    "no_authority_time": Metric("s", "time without authority", sum),
    "least_distance": Metric("m", "least distance from another agent", min),
    "least_clearance": Metric("m", "least distance from an obstacle less its clearance", min),
}
"""Every metric by its name, in the order of columns."""
METRIC_HEAD = ("agent", *(f"{n} [{m.unit}]" if m.unit else n for n, m in METRICS.items()))
"""Titles of the columns of `metric_rows`."""


def metrics_of(
    run: Recording | Track, swarm: Swarm, limits: Thresholds | None = None
) -> dict[str, dict[str, Value]]:
    """Return all metrics by agent's name, those of the swarm last, by `SWARM`.

    Raises MistakenMethodError of a user's reference.
    """
    track = run if isinstance(run, Track) else track_of(run, swarm)
    metrics = metrics_of_agents(track, swarm, limits or Thresholds())
    complete = [{name: agent.get(name) for name in METRICS} for agent in metrics]
    normal = [complete[i] for i in swarm.normal]
    return dict(zip(swarm.names, complete, strict=True)) | {SWARM: _of_swarm(normal)}


def _of_swarm(normal: Sequence[Mapping[str, Value]]) -> dict[str, Value]:
    """Combine the normal agents' metrics; None are left out, but for a time of arrival."""
    combined: dict[str, Value] = {}
    for name, metric in METRICS.items():
        values = [agent[name] for agent in normal if agent[name] is not None]
        combined[name] = metric.of_swarm(values) if values else None
    if not combined["arrived"]:
        combined["arrival_time"] = None
    return combined


class Recorded(Protocol):
    """A run with its recording."""

    @property
    def recording(self) -> Recording: ...


R = TypeVar("R", bound=Recorded)


def of(
    run: R,
    limits: Thresholds | None = None,
    **extra: Callable[[R], float | Mapping[str, float]],
) -> "pl.DataFrame":
    """Return a run's metrics: a row for each agent, and one for the swarm of its normal agents.

    Args:
        run: a finished run.
        limits: what counts as arrived and as a deadlock.
        extra: metrics of your own by name. Each is called with the run, and returns a number of the
            swarm, or numbers by agent's name.

    Raises:
        UnreadableRecordingError: the recorded scenario cannot be built.
        ValueError: a metric of your own has the name of another column, or returns something else.
    """
    swarm = swarm_of(run.recording)
    values = {name: _of_own(name, function(run), swarm.names) for name, function in extra.items()}
    return metrics_table(run.recording, swarm, limits, values)


def metrics_table(
    recording: Recording,
    swarm: Swarm,
    limits: Thresholds | None = None,
    extra: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> "pl.DataFrame":
    """Return the metrics as a data frame; extra: more of them by name, by agent."""
    with extras_named():
        import polars as pl
    from phalanx.recording.tables import of_run

    metrics = metrics_of(recording, swarm, limits)
    for name, values in extra.items():
        for agent, row in metrics.items():
            row[name] = values.get(agent)
    roles = ["adversary" if member.adversary else "normal" for member in swarm.members]
    rows = [
        {"agent": agent, "role": role, **values}
        for (agent, values), role in zip(metrics.items(), [*roles, SWARM], strict=True)
    ]
    kinds = {"agent": pl.String, "role": pl.String, "arrived": pl.Boolean}
    columns = ("agent", "role", *METRICS, *extra)
    table = pl.DataFrame(rows, schema={name: kinds.get(name, pl.Float64) for name in columns})
    return of_run(recording, table)


def _of_own(name: str, value: Any, agents: Sequence[str]) -> dict[str, float]:
    if name in (*METRICS, *_OF_ROW):
        raise ValueError(f"{name}: expected a name that no other column has")
    if isinstance(value, Real):
        return {SWARM: float(value)}
    if isinstance(value, Mapping) and all(isinstance(v, Real) for v in value.values()):
        if unknown := [agent for agent in value if agent not in agents]:
            raise ValueError(f"{name}: expected names of agents, got {unknown[0]!r}")
        return {agent: float(v) for agent, v in value.items()}
    raise ValueError(f"{name}: expected a number, or numbers by agent's name, got {value!r}")


def in_words(metrics: Mapping[str, Mapping[str, Value]], normal: Sequence[str]) -> str:
    """Describe how the swarm did its task, in a line; empty if no normal agent has a goal."""
    swarm = metrics[SWARM]
    if swarm["tracking_error_mean"] is None:
        return ""
    parts = [f"tracking error {_number(swarm['tracking_error_mean'])} m on average"]
    arrived = [metrics[name]["arrived"] for name in normal]
    resting = [arrival for arrival in arrived if arrival is not None]
    if resting:
        last = swarm["arrival_time"]
        when = "" if last is None else f", the last at {_number(last)} s"
        parts.insert(0, f"{sum(map(bool, resting))} of {len(resting)} arrived{when}")
    if swarm["deadlock_time"]:
        waiting = sum(bool(metrics[name]["deadlock_time"]) for name in normal)
        since = _number(swarm["deadlock_since"])
        parts.append(f"{waiting} of {len(normal)} stood though they wanted to move, from {since} s")
    if swarm["least_distance"] is not None:
        parts.append(f"least distance {_number(swarm['least_distance'])} m")
    return ", ".join(parts)


def metric_rows(metrics: Mapping[str, Mapping[str, Value]]) -> list[tuple[str, ...]]:
    """Return a row of texts for each agent, the swarm's first."""
    agents = sorted(metrics, key=lambda name: name != SWARM)
    return [(name, *(_number(metrics[name][metric]) for metric in METRICS)) for name in agents]


def _number(value: Value) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}"
