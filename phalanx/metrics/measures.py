"""Measures of one agent's task, from arrays alone.

Positions are output points at the recorded times t, shape (s, d); between them they count as
straight. An input counts from the instant it is applied until the agent's next one.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from phalanx.arrays import Array
from phalanx.theory.expressions.exact import dot, length

_WINDOW = 50
"""Steps into which an agent's patience is divided."""

_MOST_STEPS = 10**6
"""A day of virtual time; a damaged recording may have any time."""


@dataclass(frozen=True)
class Thresholds:
    """The limits that decide whether an agent has arrived, or is in deadlock."""

    arrival: float = 0.5
    """An agent is at its goal within this distance [m]."""
    still: float = 0.25
    """An agent stands while its output point stays within this distance of a point [m]."""
    patience: float = 5.0
    """An agent that stands for this long away from its goal is in deadlock [s]."""


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
    apart = length(inputs.u - inputs.u_nom)
    known = np.isfinite(apart)
    duration = float(inputs.duration[known].sum())
    return float(dot(inputs.duration[known], apart[known])) / duration if duration else None


def deadlock_time(t: Array, position: Array, error: Array, limits: Thresholds) -> float:
    """Return for how long an agent is in deadlock [s].

    It is in deadlock during each stretch of length `patience` in which its output point stays
    within `still` of the stretch's first, and farther than `arrival` from its goal throughout.
    Stretches that overlap count once.

    Args:
        t: shape (s,) [s].
        position: shape (s, d) [m].
        error: the distance from the goal, shape (s,) [m].
        limits: the definition's constants.
    """
    step = limits.patience / _WINDOW
    steps = int(min(round(float(t[-1] - t[0]) / step, 6), _MOST_STEPS)) if len(t) else 0
    if steps < _WINDOW:
        return 0.0
    grid = t[0] + step * np.arange(steps + 1)
    places = np.column_stack([np.interp(grid, t, axis) for axis in position.T])
    stretches = len(grid) - _WINDOW
    moved = np.zeros(stretches)
    for later in range(1, _WINDOW + 1):
        apart = length(places[later : later + stretches] - places[:stretches])
        np.maximum(moved, apart, out=moved)
    away = sliding_window_view(np.interp(grid, t, error), _WINDOW + 1).min(axis=1)
    stuck = (moved <= limits.still) & (away > limits.arrival)
    covered = np.convolve(stuck, np.ones(_WINDOW)) > 0
    return float(covered.sum() * step)
