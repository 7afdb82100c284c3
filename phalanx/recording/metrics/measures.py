"""Metrics of each agent's task: its true states, and the inputs that took effect.

Positions are output points at the recorded times t, shape (s, d); between them they count as
straight. An input counts from the instant it is applied until the agent's next one.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phalanx.guarantee.verdict import Deadlock
from phalanx.recording.columns import ORIGINS, Inputs, States, Track, indices, inputs_of
from phalanx.recording.deadlock import STILL, DeadlockWatch
from phalanx.recording.read import Recording
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, dot, length
from phalanx.theory.rows.origin import Origin

Value = float | bool | None


@dataclass(frozen=True)
class Thresholds:
    """The limits that decide whether an agent has arrived, or is in deadlock."""

    arrival: float = 0.5
    """An agent is at its goal within this distance [m]."""
    still: float = STILL
    """An agent stands while its output point, and how far the nearest other is, change less [m]."""
    patience: float | None = None
    """An agent that stands for this long though it wants to move is in deadlock [s]; by default 5,
    but at most a fifth of the scenario's duration."""

    @property
    def of_deadlocks(self) -> tuple[float, float | None]:
        """Return the limits of a DeadlockWatch."""
        return self.still, self.patience


_USUAL = Thresholds()


class InputSeries(NamedTuple):
    """An agent's applied inputs."""

    duration: Array
    """The time for which each was in force [s], shape (k,)."""
    u: Array
    """Shape (k, m)."""
    u_nom: Array
    """The law's inputs, shape (k, m); NaN where they are unknown."""


def mean_over_time(t: Array, values: Array) -> float | None:
    """Return the mean of values, shape (s,), over the time [s]; None of nothing."""
    if len(t) == 0:
        return None
    duration = float(t[-1] - t[0])
    return float(np.trapezoid(values, t)) / duration if duration else float(values[-1])


def arrival_time(t: Array, distance: Array, within: float) -> float | None:
    """Return the first time from which on a distance [m] stays within a bound; None if never."""
    outside = np.flatnonzero(distance > within)
    first = int(outside[-1]) + 1 if len(outside) else 0
    return float(t[first]) if first < len(t) else None


def input_energy(inputs: InputSeries) -> float:
    """Return ∫ ‖u‖² dt, in the square of the inputs' units times s."""
    return float(dot(inputs.duration, dot(inputs.u, inputs.u)))


def input_deviation(inputs: InputSeries) -> float | None:
    """Return the mean of ‖u - u_nom‖ over the time for which u_nom is known; None if there is none.

    Before its projection a nominal input may lie outside the bounds of the input.
    """
    deviation = length(inputs.u - inputs.u_nom)
    finite = np.isfinite(deviation)
    duration = float(inputs.duration[finite].sum())
    return float(dot(inputs.duration[finite], deviation[finite])) / duration if duration else None


def track_of(recording: Recording, swarm: Swarm) -> Track:
    """Return the states, inputs and deadlocks of a recording."""
    t, steps = recording.times, recording.steps
    at = np.array([step.t_apply for step in steps])
    # An input at the time of a state comes after it, as do those recorded later.
    before = np.searchsorted(np.maximum.accumulate(at), t)
    after = np.searchsorted(before, np.arange(len(steps)), side="right")
    index = {name: i for i, name in enumerate(swarm.names)}
    events = [
        (n + int(states), index[step.agent], step.k, step.t, step.t_apply, False)
        for n, (step, states) in enumerate(zip(steps, after.tolist(), strict=True))
    ]
    widths = indices([len(m.dynamics.inputs) for m in swarm.members])
    x = recording.x.reshape(len(t), swarm.safe_set.parts[-1].stop)
    states = States(before + np.arange(len(t)), t, x)
    inputs = inputs_of(events, [step.u for step in steps], steps, widths)
    return Track(states, inputs, recording.summary.deadlocks if recording.summary else None)


def metrics_of_agents(track: Track, swarm: Swarm, limits: Thresholds) -> list[dict[str, Value]]:
    """Return each agent's metrics by name, in the scenario's order; None where one has no meaning.

    Raises MistakenMethodError of a user's reference.
    """
    (_, t, x), parts = track.states, swarm.safe_set.parts
    end = float(t[-1]) if len(t) else 0.0
    p = swarm.positions(x)
    deadlocks, watched = _deadlocks(track, swarm, limits), swarm.normal if len(t) else ()
    states = [{l: state[part] for l, part in enumerate(parts)} for state in x]
    with np.errstate(over="ignore", invalid="ignore"):  # numbers may be as large as floats are
        return [
            {
                **_task(swarm, i, t, states, p[:, i], limits),
                **_distances(swarm, i, p),
                **_inputs(track.inputs, i, len(member.dynamics.inputs), end),
                **(_deadlock(member.name, deadlocks, end) if i in watched else {}),
            }
            for i, member in enumerate(swarm.members)
        ]


def deadlocks_of(recording: Recording, swarm: Swarm, limits: Thresholds = _USUAL) -> list[Deadlock]:
    """Return the deadlocks that the plant recorded; watch again with other limits, or without."""
    return _deadlocks(track_of(recording, swarm), swarm, limits)


def _deadlocks(track: Track, swarm: Swarm, limits: Thresholds) -> list[Deadlock]:
    if track.deadlocks is not None and limits.of_deadlocks == _USUAL.of_deadlocks:
        return track.deadlocks
    watch = DeadlockWatch(swarm, *limits.of_deadlocks)
    watch.add(track.states, track.inputs)
    return watch.deadlocks


def _task(
    swarm: Swarm, i: int, t: Array, states: Sequence[Mapping[int, Array]], p: Array,
    limits: Thresholds,
) -> dict[str, Value]:  # fmt: skip
    """Return the metrics of agent i's goal, of which it may have none.

    states: of all agents at each of the times t. p: agent i's positions [m], shape (s, d).
    """
    if not swarm.has_goal(i) or not len(t):
        return {}
    goal = swarm.goal(i)
    error = length(p - goal.positions(t, states))
    metrics: dict[str, Value] = {
        "tracking_error_mean": mean_over_time(t, error),
        "tracking_error_final": float(error[-1]),
    }
    rest = goal.end()
    if rest is None:
        return metrics
    distance = length(p - rest)
    arrival = arrival_time(t, distance, limits.arrival)
    return metrics | {
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
    to_others = length(others - p[:, i : i + 1]).min() if others.size else None
    return {
        "least_distance": None if to_others is None else float(to_others),
        "least_clearance": min(to_obstacles, default=None),
    }


def _deadlock(name: str, deadlocks: Sequence[Deadlock], duration: float) -> dict[str, Value]:
    """Return for how long an agent is in deadlock, and since when; duration: of the run [s]."""
    waits = [deadlock for deadlock in deadlocks if deadlock.agent == name]
    time = added([deadlock.end - deadlock.begin for deadlock in waits])
    return {
        "deadlock_time": time,
        "deadlock_share": time / duration if duration else 0.0,
        "deadlock_since": min((deadlock.begin for deadlock in waits), default=None),
    }


def _inputs(inputs: Inputs, i: int, width: int, end: float) -> dict[str, Value]:
    """Return the metrics of agent i's inputs, `width` numbers each, up to the end [s]."""
    rows = np.flatnonzero(inputs.i == i)
    if not len(rows):
        return {}
    rows = rows[np.argsort(inputs.t_apply[rows], kind="stable")]
    applied = np.minimum(np.append(inputs.t_apply[rows], end), end)
    duration = np.maximum(np.diff(applied), 0.0)
    series = InputSeries(duration, inputs.u[rows, :width], inputs.u_nom[rows, :width])
    origins = inputs.origin[rows]

    def time_with(origin: Origin) -> float:
        return added(duration[origins == ORIGINS[origin]].tolist())

    return {
        "input_energy": input_energy(series),
        "input_deviation_mean": input_deviation(series),
        "backup_time": time_with(Origin.BACKUP),
        "no_authority_time": time_with(Origin.NO_AUTHORITY),
    }
