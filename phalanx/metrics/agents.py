"""The metrics of each agent, from a recording: its true states and the inputs that took effect."""

from collections.abc import Mapping, Sequence

import numpy as np

from phalanx.arrays import Array
from phalanx.metrics.measures import (
    InputSeries,
    Thresholds,
    arrival_time,
    deadlock_time,
    input_deviation,
    input_energy,
    mean_over_time,
)
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.exact import added, length
from phalanx.theory.rows.origin import Origin

Value = float | bool | None


def metrics_of_agents(
    recording: Recording, swarm: Swarm, limits: Thresholds
) -> list[dict[str, Value]]:
    """Return each agent's metrics by name, in the scenario's order; None where one has no meaning.

    Raises MistakenMethodError of a user's reference.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # numbers may be as large as floats are
        return _metrics(recording, swarm, limits)


def _metrics(recording: Recording, swarm: Swarm, limits: Thresholds) -> list[dict[str, Value]]:
    t, x = recording.times, recording.x
    end = float(t[-1]) if len(t) else 0.0
    axes = swarm.groups[0].axes
    p = np.array([swarm.positions(each) for each in x]).reshape(len(t), len(swarm.names), axes)
    steps = list(steps_by_agent(recording).values())
    parts = swarm.safe_set.parts
    states = [{l: each[part] for l, part in enumerate(parts)} for each in x]
    return [
        {
            **_task(swarm, i, t, states, p[:, i], limits),
            **_distances(swarm, i, p),
            **_inputs(steps[i], len(swarm.members[i].dynamics.inputs), end),
        }
        for i in range(len(swarm.names))
    ]


def _task(
    swarm: Swarm,
    i: int,
    t: Array,
    states: Sequence[Mapping[int, Array]],
    p: Array,
    limits: Thresholds,
) -> dict[str, Value]:
    """Return the metrics of agent i's goal, of which it may have none.

    states: of all agents at each of the times t. p: agent i's positions [m], shape (s, d).
    """
    if not swarm.has_goal(i) or not len(t):
        return {}
    goal = swarm.goal(i)
    desired = [goal(at, x).position for at, x in zip(t.tolist(), states, strict=True)]
    error = length(p - np.array(desired))
    found: dict[str, Value] = {
        "tracking_error_mean": mean_over_time(t, error),
        "tracking_error_final": float(error[-1]),
        "deadlock_time": deadlock_time(t, p, error, limits),
    }
    rest = goal.end()
    if rest is None:
        return found
    distance = length(p - rest)
    arrival = arrival_time(t, distance, limits.arrival)
    return found | {
        "distance_to_goal": float(distance[-1]),
        "arrived": arrival is not None,
        "arrival_time": arrival,
    }


def _distances(swarm: Swarm, i: int, p: Array) -> dict[str, Value]:
    """Return agent i's least distances, from the positions of all, shape (s, N, d)."""
    if not len(p):
        return {}
    others = np.delete(p, i, axis=1)
    to_obstacles = [
        float((obstacle.distances(p[:, i]) - obstacle.clearance).min())
        for obstacle in swarm.scenario.obstacles
    ]
    return {
        "least_distance": float(length(others - p[:, i : i + 1]).min(initial=np.inf))
        if others.size
        else None,
        "least_clearance": min(to_obstacles, default=None),
    }


def _inputs(steps: Sequence[Step], width: int, end: float) -> dict[str, Value]:
    """Return the metrics of an agent's inputs, `width` numbers each, up to the end [s]."""
    if not steps:
        return {}
    ordered = sorted(steps, key=lambda step: step.t_apply)
    applied = np.minimum([*(step.t_apply for step in ordered), end], end)
    duration = np.maximum(np.diff(applied), 0.0)
    unknown = (np.nan,) * width
    inputs = InputSeries(
        duration,
        np.array([step.u for step in ordered]),
        np.array([step.u_nom or unknown for step in ordered]),
    )
    in_force = list(zip(ordered, duration.tolist(), strict=True))

    def time_with(origin: Origin) -> float:
        return added(seconds for step, seconds in in_force if step.origin == origin)

    return {
        "input_energy": input_energy(inputs),
        "input_deviation_mean": input_deviation(inputs),
        "backup_time": time_with(Origin.BACKUP),
        "no_authority_time": time_with(Origin.NO_AUTHORITY),
    }
