"""The metrics of a run as text."""

from collections.abc import Mapping, Sequence

from phalanx.metrics.agents import Value
from phalanx.metrics.table import METRICS, SWARM


def in_words(metrics: Mapping[str, Mapping[str, Value]], normal: Sequence[str]) -> str:
    """Describe how the swarm did its task, in a line; empty if no normal agent has a goal."""
    swarm = metrics[SWARM]
    if swarm["tracking_error_mean"] is None:
        return ""
    parts = [f"tracking error {_number(swarm['tracking_error_mean'])} m on average"]
    arrived = [metrics[name]["arrived"] for name in normal]
    resting = [each for each in arrived if each is not None]
    if resting:
        last = swarm["arrival_time"]
        when = "" if last is None else f", the last at {_number(last)} s"
        parts.insert(0, f"{sum(map(bool, resting))} of {len(resting)} arrived{when}")
    if swarm["deadlock_time"]:
        parts.append(f"deadlock for {_number(swarm['deadlock_time'])} s")
    if swarm["least_distance"] is not None:
        parts.append(f"least distance {_number(swarm['least_distance'])} m")
    return ", ".join(parts)


def metric_rows(metrics: Mapping[str, Mapping[str, Value]]) -> list[tuple[str, ...]]:
    """Return a row of texts for each agent, the swarm's first; the columns are `METRIC_HEAD`."""
    agents = sorted(metrics, key=lambda name: name != SWARM)
    return [(name, *(_number(metrics[name][metric]) for metric in METRICS)) for name in agents]


def swarm_rows(metrics: Mapping[str, Mapping[str, Value]]) -> list[tuple[str, str]]:
    """Return each metric of the swarm by title; none if it has no value."""
    found = metrics[SWARM]
    return [
        (title, _number(found[name]))
        for (name, title) in zip(METRICS, METRIC_HEAD[1:], strict=True)
        if found[name] is not None
    ]


def _title(name: str) -> str:
    unit = METRICS[name].unit
    return f"{name} [{unit}]" if unit else name


METRIC_HEAD: Sequence[str] = ("agent", *map(_title, METRICS))


def _number(value: Value) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}"
