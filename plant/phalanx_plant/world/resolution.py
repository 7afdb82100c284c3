"""Bound the defect of integration steps against the equation of motion, by interval arithmetic.

The end x(s) of a Runge-Kutta step is a function of its length s, and x(s), 0 <= s <= dt, is the
world's motion from one state to the next. Its defect is δ(s) = x'(s) - f - g u - φ(s): it obeys the
equation of motion under the disturbance φ + δ. A fourth-order step has δ = δ' = δ'' = 0 at s = 0,
so ‖δ(s)‖ <= dt³/6 sup ‖δ'''‖ where δ'' does not jump. One bound covers all agents of equal
dynamics, and all steps passed in one call.
"""

from functools import partial

import casadi as ca
import numpy as np

from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.cache import cached
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, point
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import scalars
from phalanx.theory.models.dynamics import Dynamics, motion_texts, weighted_rates
from phalanx_plant.world.motion import by_dynamics
from phalanx_plant.world.segments import Segments

_ROUNDED = 2.0**-50
"""Rounding error of a state after a step, relative to the state."""


class Resolution:
    """The defects of a run's integration steps."""

    def __init__(self, swarm: Swarm) -> None:
        # Another run of this process may have had such dynamics.
        self._groups = [
            (cached(("defect", *motion_texts([g.dynamics])), partial(_defect, g.dynamics)), g)
            for g in by_dynamics(swarm.members)
        ]
        """By dynamics: the bound, and its agents."""

    def resolved(self, segments: Segments, rates: Array) -> Mask:
        """Return whether the defect and rounding of each step are at most DEFECT, shape (s,).

        rates: of the rounding of the segments' steps [1/s], shape (s,).
        """
        # A bound for all holds for each, and is hardly ever too large. If it is, halves have their
        # own: which segments are judged together depends on the wall clock.
        count, defect = len(segments.t), self.defect(segments)
        if count == 1 or defect + rates.max() <= DEFECT:
            return defect + rates <= DEFECT
        half = count // 2
        steps = int(segments.counts[:half].sum())
        first = self.resolved(segments.between(0, half), rates[:steps])
        return np.append(first, self.resolved(segments.between(half, count), rates[steps:]))

    def defect(self, segments: Segments) -> float:
        """Bound the defect of all steps of these segments [1/s]; inf or nan if there is none."""
        dt, steps, phi, slope = segments.dt, segments.counts, segments.phi, segments.slope
        phi = np.concatenate([phi, phi + (steps * dt)[:, None] * slope])
        values = np.concatenate([segments.x, segments.start]), segments.u, phi, slope
        bounds, ranges = list[float](), list(map(_range, values))
        for largest, (_, _, states, inputs) in self._groups:
            indices = states, inputs, states, states
            row = np.concatenate([*map(_over, ranges, indices), [dt.max()]])
            bounds.append(largest(row, np.arange(len(row))[None])[0, 0])
        return float(np.max(bounds))


class Roundings:
    """The rounding of a run's states as a rate, over the longest step's time.

    Events may be one float64 apart, and steps with them: each one counts, however short.
    """

    def __init__(self, longest: float) -> None:
        """longest: of the steps [s]."""
        self._longest, self._recent = longest, np.zeros((2, 0))
        """Times [s] and errors of the steps within that time."""

    def rates(self, times: Array, x: Array) -> Array:
        """Bound the rate until the end of each of the next s steps [1/s], shape (s,).

        times [s] and states there, shapes (s,) and (s, n̄); all calls are in order.
        """
        before = self._recent[:, self._recent[0] < times[0]]  # the last events may be judged again
        steps = np.hstack([before, [times, _ROUNDED * np.abs(x).max(axis=1)]])
        t, errors = steps
        total, first = np.cumsum(errors), np.searchsorted(t, t - self._longest, side="right")
        self._recent = steps[:, first[-1] :]
        rates: Array = (total - (total - errors)[first]) / self._longest
        return rates[-len(times) :]


def _range(values: Array) -> Array:
    """Minimum and maximum of each component, shape (2, n)."""
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _over(ends: Array, indices: Index) -> Array:
    """Minima and maxima over agents with components at these indices, (r, n); shape (2 n,)."""
    low, high = ends
    return np.concatenate([low[indices].min(axis=0), high[indices].max(axis=0)])


@outwards()
def _defect(dynamics: Dynamics) -> MappedFunction:
    """Bounds of x, u, φ and φ', and dt -> the largest defect; inf where there is no bound."""
    sizes = len(dynamics.states), len(dynamics.inputs), len(dynamics.states), len(dynamics.states)
    x, u, phi, slope = (ca.SX.sym(name, n) for name, n in zip("xupl", sizes, strict=True))
    s, dt = ca.SX.sym("s"), ca.SX.sym("dt")
    field = ca.Function("f", [x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
    pushes = phi, phi + s / 2 * slope, phi + s * slope
    step = s / 6 * weighted_rates(field, x, u, pushes, s)
    defect = ca.jacobian(step, s) - field(x + step, u) - pushes[-1]
    second = ca.jacobian(ca.jacobian(defect, s), s)
    bound = dt * dt * dt / 6 * ca.norm_1(ca.jacobian(second, s))
    ends = [ca.SX.sym("ends", n, 2) for n in sizes]
    box = [Interval(end[k, 0], end[k, 1]) for end in ends for k in range(end.shape[0])]
    box += [Interval(ca.SX(0.0), dt), point(dt)]
    symbols, row = scalars([x, u, phi, slope, s, dt]), [*map(ca.vec, ends), dt]
    try:
        (largest,) = extend([bound], symbols, box)
        smooth = continuous(ca.vertsplit(second), symbols, box)
    except UnboundedOperationError:
        return MappedFunction(row, [ca.SX(ca.inf)])
    return MappedFunction(row, [ca.if_else(smooth, largest.hi, ca.inf)])
