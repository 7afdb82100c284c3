"""How far integration steps are off the equation of motion, in interval arithmetic.

Of a step of Runge-Kutta x(s) is a function of its length s, and x(s), 0 <= s <= dt, is the world's
motion from one state to the next. Its defect is δ(s) = x'(s) - f - g u - φ(s): it moves as the
equation does under the disturbance φ + δ. A step of fourth order has δ = δ' = δ'' = 0 at s = 0, so
that ‖δ(s)‖ <= s³/6 sup ‖δ'''‖ where δ'' does not jump. That is bounded for all agents at once that
move by one equation, and for all of their states if it has a bound there.
"""

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.guarantee.certificate import DEFECT
from phalanx.plant.world.integration import Passage
from phalanx.plant.world.motion import alike, weighted_rates
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, point
from phalanx.theory.expressions.mapped import MappedFunction
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import admissible_inputs, scalars
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.composition import stacked_slices

_ROUNDED = 2.0**-50
"""By which share of itself a state may be off after a step, for rounding."""


class Resolution:
    """The defects of a run's integration steps."""

    def __init__(self, swarm: Swarm) -> None:
        members, self._longest = swarm.members, swarm.scenario.time.integration_step
        states = swarm.safe_set.parts
        inputs = stacked_slices([len(m.dynamics.inputs) for m in members])
        self._kinds = [
            (defect, [np.array([np.r_[part[l]] for l in own]) for part in (states, inputs)])
            for own in alike(members)
            for defect in [_defect(members[own[0]].dynamics)]
            if not all(self._is_small_anywhere(swarm, l, defect) for l in own)
        ]
        """Those that depend on the state, and where states and inputs lie: (r, n) and (r, m)."""

    def defect(self, passage: Passage) -> float:
        """At most how far the steps of a passage are off [1/s]; inf where that is not known."""
        dt, slope = passage.stretch.dt, passage.slope
        states = np.vstack([passage.start, passage.x])
        pushed = np.stack([passage.phi, passage.phi + passage.stretch.steps * dt * slope])
        found = [0.0]
        for defect, (x, u) in self._kinds:
            parts = (states, x), (passage.u, u), (pushed, x), (dt * slope, x)
            ends = [_ends(values[..., places]) for values, places in parts]
            found.append(_value(defect, np.concatenate([*ends, [dt]])))
        return _ROUNDED / self._longest * float(np.abs(states).max()) + max(found)

    def _is_small_anywhere(self, swarm: Swarm, l: int, defect: MappedFunction) -> bool:
        """Whether agent l's is, whatever its state, input and disturbance."""
        try:
            inputs = admissible_inputs(swarm.members[l])
        except ValueError:  # U depends on the state
            return False
        n, bound = len(swarm.members[l].dynamics.states), swarm.groups[l].disturbance.bound
        u = np.array([[float(end) for end in interval] for interval in inputs]).T.ravel()
        x, phi, rise = (np.repeat([-most, most], n) for most in (np.inf, bound, 2 * bound))
        return _value(defect, np.concatenate([x, u, phi, rise, [self._longest]])) <= DEFECT / 2


def _ends(values: Array) -> Array:
    """The least and the largest of each component, over all other axes."""
    each = values.reshape(-1, values.shape[-1])
    return np.concatenate([each.min(axis=0), each.max(axis=0)])


def _value(function: MappedFunction, row: Array) -> float:
    found = float(function(row, np.arange(len(row))[None])[0, 0])
    return np.inf if np.isnan(found) else found


@outwards()
def _defect(dynamics: Dynamics) -> MappedFunction:
    """Ends of x, u, φ and φ' dt, and dt -> the largest defect; inf where it is not known."""
    sizes = len(dynamics.states), len(dynamics.inputs), len(dynamics.states), len(dynamics.states)
    x, u, phi, rise = (ca.SX.sym(name, n) for name, n in zip("xupr", sizes, strict=True))
    dt, share = ca.SX.sym("dt"), ca.SX.sym("share")  # s = share dt
    field = ca.Function("f", [x, u], [dynamics.drift(x) + dynamics.actuation(x) @ u])
    pushes = phi, phi + share / 2 * rise, phi + share * rise
    mean = weighted_rates(field, x, u, pushes, share * dt) / 6
    after = x + share * dt * mean
    defect = mean + share * ca.jacobian(mean, share) - field(after, u) - pushes[-1]
    second = ca.jacobian(ca.jacobian(defect, share), share)
    third = ca.norm_1(ca.jacobian(second, share)) / 6
    ends = [ca.SX.sym("ends", n, 2) for n in sizes]
    box = [Interval(each[k, 0], each[k, 1]) for each in ends for k in range(each.shape[0])]
    box += [point(dt), Interval(ca.SX(0.0), ca.SX(1.0))]
    symbols, row = scalars([x, u, phi, rise, dt, share]), [*map(ca.vec, ends), dt]
    try:
        (largest,) = extend([third], symbols, box)
        smooth = continuous(ca.vertsplit(second), symbols, box)
    except UnboundedOperationError:
        return MappedFunction(row, [ca.SX(ca.inf)])
    return MappedFunction(row, [ca.if_else(smooth, largest.hi, ca.inf)])
