"""Deadlock: an agent that wants to move, is held by its rows, and waits in one place.

It does so by its inputs and positions alone, whether it has a goal or not.
"""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from phalanx.recording.records import Step
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.rows.qp import NearestInput

_WINDOW = 50
"""Steps into which an agent's patience is divided."""
_MOST_STEPS = 10**6
"""A day of virtual time; a damaged recording may have any time."""
_WISHES = 0.1
"""Share of an agent's largest input from which a wish is one to move, and a row holds it."""


class Wait(NamedTuple):
    """A stretch of time in deadlock."""

    begin: float
    """[s]"""
    end: float
    """[s]"""
    nearest: str
    """The other agent or obstacle that was nearest when it began."""


def waits(
    t: Array, position: Array, nearest: Array, held: Array, still: float, patience: float
) -> list[tuple[float, float]]:
    """Return the stretches of time in deadlock [s].

    An agent is in deadlock during each stretch of length `patience` in which its output point and
    the distance to the nearest other stay within `still`, and its wish is held for most of it.

    Args:
        t: times [s], shape (s,).
        position: output point [m], shape (s, d).
        nearest: distance to the nearest other [m], shape (s,).
        held: 1 where its wish is held, else 0; shape (s,).
        still: [m]
        patience: [s]
    """
    step = patience / _WINDOW
    steps = int(min(round(float(t[-1] - t[0]) / step, 6), _MOST_STEPS)) if len(t) else 0
    if steps < _WINDOW:
        return []
    grid = t[0] + step * np.arange(steps + 1)
    points = np.column_stack([np.interp(grid, t, axis) for axis in position.T])
    stretches = len(grid) - _WINDOW
    moved = np.zeros(stretches)
    for later in range(1, _WINDOW + 1):
        distance = length(points[later : later + stretches] - points[:stretches])
        np.maximum(moved, distance, out=moved)
    around, wish = (
        sliding_window_view(np.interp(grid, t, v), _WINDOW + 1) for v in (nearest, held)
    )
    same = np.ptp(np.where(np.isfinite(around), around, 0.0), axis=1) <= still
    stuck = (moved <= still) & same & (wish.mean(axis=1) > 0.5)
    covered = np.concatenate([[0.0], np.convolve(stuck, np.ones(_WINDOW)) > 0, [0.0]])
    (begins,), (ends,) = np.nonzero(np.diff(covered) > 0), np.nonzero(np.diff(covered) < 0)
    return list(zip(grid[begins].tolist(), (t[0] + step * ends).tolist(), strict=True))


def held_by_rows(dynamics: Dynamics, steps: Sequence[Step], t: Array) -> Array:
    """Return 1 at the times [s] at which an agent wants to move and its rows do not let it, else 0.

    A wish beyond U_i is one for the nearest input in it, where U_i is constant; where it is not,
    the largest input is that of all steps. Shape (s,).
    """
    inputs = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", len(dynamics.states))))
    nearest = NearestInput(dynamics.input_metric())
    sizes = [step.u for step in steps] if inputs is None else inputs.corners
    least = _WISHES * float(length(np.array(sizes)).max(initial=0.0))
    held = [0.0]
    for step in (ordered := sorted(steps, key=lambda step: step.t_apply)):
        u, wish = np.array(step.u), np.array(step.u_nom or step.u)
        if inputs is not None:
            within = nearest.solve(wish, inputs)
            wish = u if within is None else within
        held.append(float(min(length(wish), length(u - wish)) > least))
    times = np.array([step.t_apply for step in ordered])
    of_step = np.searchsorted(times, t, side="right")
    # One that died wants nothing, though its actuator holds its last input.
    until = times[-1] + 2.0 * float(np.diff(times).max()) if len(times) > 1 else np.inf
    return np.where(t <= until, np.array(held)[of_step], 0.0)


def deadlocks(
    swarm: Swarm, i: int, steps: Sequence[Step], t: Array, p: Array, still: float, patience: float
) -> list[Wait]:
    """Return agent i's stretches in deadlock, from the positions of all, shape (s, N, d) [m]."""
    labels = swarm.safe_set.labels
    distances = length(p - p[:, i : i + 1])
    distances[:, i] = np.inf
    statics = [o.distances(p[:, i]) - o.clearance for o in swarm.scenario.obstacles]
    distances = np.column_stack([distances, *statics])
    held = held_by_rows(swarm.members[i].dynamics, steps, t)
    stretches = waits(t, p[:, i], distances.min(axis=1), held, still, patience)
    begins = np.searchsorted(t, [begin for begin, _ in stretches])
    nearest = distances[np.minimum(begins, len(t) - 1)].argmin(axis=1).tolist()
    return [Wait(*ends, labels[l]) for ends, l in zip(stretches, nearest, strict=True)]
