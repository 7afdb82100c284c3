"""How far integration steps are off the equation of motion, in interval arithmetic.

Of a step of Runge-Kutta x(s) is a function of its length s, and x(s), 0 <= s <= dt, is the world's
motion from one state to the next. Its defect is δ(s) = x'(s) - f - g u - φ(s): it moves as the
equation does under the disturbance φ + δ. A step of fourth order has δ = δ' = δ'' = 0 at s = 0, so
that ‖δ(s)‖ <= dt³/6 sup ‖δ'''‖ where δ'' does not jump. One bound serves all agents that move by
one equation, and all steps that it is asked of at once.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index, Mask
from phalanx.guarantee.certificate import DEFECT
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, point
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import scalars
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.composition import stacked_slices
from phalanx_plant.world.motion import alike, weighted_rates
from phalanx_plant.world.world import Passage

_ROUNDED = 2.0**-50
"""By which share of itself a state may be off after a step, for rounding."""


class Resolution:
    """The defects of a run's integration steps."""

    def __init__(self, swarm: Swarm) -> None:
        members, self._longest = swarm.members, swarm.time.integration_step
        inputs = stacked_slices([len(m.dynamics.inputs) for m in members])
        self._kinds = [
            (
                _defect(members[own[0]].dynamics),
                np.array([np.r_[swarm.safe_set.parts[l]] for l in own]),
                np.array([np.r_[inputs[l]] for l in own]),
            )
            for own in alike(members)
        ]
        """Of each equation, and where states and inputs of its agents lie: (r, n) and (r, m)."""

    def resolves(self, passages: Sequence[Passage]) -> Mask:
        """Whether each passage is known to be off by at most DEFECT, shape (p,)."""
        # A bound of all is one of each, and hardly ever too large.
        if self.defect(passages) <= DEFECT:
            return np.ones(len(passages), dtype=bool)
        return np.array([self.defect([passage]) <= DEFECT for passage in passages])

    def defect(self, passages: Sequence[Passage]) -> float:
        """At most how far any step of these is off [1/s]; inf or nan if that is not known."""
        x = np.concatenate([*[p.x for p in passages], [p.start for p in passages]])
        u, phi, slope = map(np.array, zip(*[(p.u, p.phi, p.slope) for p in passages], strict=True))
        dt, steps = np.array([(p.stretch.dt, p.stretch.steps) for p in passages]).T
        phi = np.concatenate([phi, phi + (steps * dt)[:, None] * slope])
        parts, found = list(map(_ends, (x, u, phi, slope))), list[float]()
        for largest, states, inputs in self._kinds:
            places = states, inputs, states, states
            row = np.concatenate([*map(_over, parts, places), [dt.max()]])
            found.append(largest(row, np.arange(len(row))[None])[0, 0])
        return float(_ROUNDED / self._longest * np.abs(parts[0]).max() + np.max(found))


def _ends(values: Array) -> Array:
    """The least and the largest of each component, shape (2, n)."""
    return np.stack([values.min(axis=0), values.max(axis=0)])


def _over(ends: Array, places: Index) -> Array:
    """The same over agents whose components lie at these places, (r, n), shape (2 n,)."""
    low, high = ends
    return np.concatenate([low[places].min(axis=0), high[places].max(axis=0)])


@outwards()
def _defect(dynamics: Dynamics) -> MappedFunction:
    """Ends of x, u, φ and φ', and dt -> the largest defect; inf where it is not known."""
    sizes = len(dynamics.states), len(dynamics.inputs), len(dynamics.states), len(dynamics.states)
    x, u, phi, slope = (ca.SX.sym(name, n) for name, n in zip("xupl", sizes, strict=True))
    s, dt = ca.SX.sym("s"), ca.SX.sym("dt")
    field = ca.Function("f", [x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
    pushes = phi, phi + s / 2 * slope, phi + s * slope
    way = s / 6 * weighted_rates(field, x, u, pushes, s)
    defect = ca.jacobian(way, s) - field(x + way, u) - pushes[-1]
    second = ca.jacobian(ca.jacobian(defect, s), s)
    bound = dt * dt * dt / 6 * ca.norm_1(ca.jacobian(second, s))
    ends = [ca.SX.sym("ends", n, 2) for n in sizes]
    box = [Interval(each[k, 0], each[k, 1]) for each in ends for k in range(each.shape[0])]
    box += [Interval(ca.SX(0.0), dt), point(dt)]
    symbols, row = scalars([x, u, phi, slope, s, dt]), [*map(ca.vec, ends), dt]
    try:
        (largest,) = extend([bound], symbols, box)
        smooth = continuous(ca.vertsplit(second), symbols, box)
    except UnboundedOperationError:
        return MappedFunction(row, [ca.SX(ca.inf)])
    return MappedFunction(row, [ca.if_else(smooth, largest.hi, ca.inf)])
