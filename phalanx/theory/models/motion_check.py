"""The motion check: whether an announced input explains where an agent went.

A window is two samples of an agent l, at 0 and T, and the inputs û_s that it announced to hold for
its parts T_s, with Σ T_s = T. Let B contain every state of l in the window (Lemma 1 of
docs/certificate.md, with φ_l^max and the announced inputs), and F_s be the box of f + g û_s over B.
If l did hold them, x(T) - x(0) = Σ ∫ (f + g û_s) + ∫ φ. The mean of f + g û_s over its part lies in
F_s, which is convex, and the mean of φ in the ball of radius φ_l^max. So

    dist((x(T) - x(0)) / T, Σ (T_s / T) F_s) <= φ_l^max,

and l is convicted if and only if it is farther. *No false conviction*: the truth satisfies this.
*What is not convicted is a disturbance*: some mean disturbance within the bound gives the same
ends, up to the width of Σ (T_s / T) F_s. *Delay*: a lie that is off by δu for all of a window is
convicted in it if ‖g δu‖ is above 2 φ_l^max, plus that width.

Both samples may be off by a sensor's error, in norm: 2 error / T is then allowed as well, and B
contains every motion from the box around the first sample. *States are rounded*, by 2^-53 |x_n| a
step, a high rate in a short window. 16 steps in each of the s parts are allowed for: in total
s 2^-49 (Σ |x_n(0)| + Σ |x_n(T)|) / T.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.extension import extend
from phalanx.theory.expressions.interval import (
    Interval,
    add,
    finite,
    hull,
    inflate,
    inside,
    multiply,
    point,
)
from phalanx.theory.expressions.rounding import LEAST, outwards
from phalanx.theory.models.dynamics import Dynamics

_INFLATIONS = (0.5, 0.5, 0.3, 0.1)
_LEAST = 1e-9
_ROUNDING = 1e-9
"""Allowed for rounding of rates and of the states in millions of further steps a second."""
_ROUNDED = 2.0**-49
"""Allowed for rounding of the states in one part of a window, relative to its ends."""


class MotionCheck:
    """The motion check of agents with one dynamics and one bound on the disturbance."""

    def __init__(self, dynamics: Dynamics, bound: float, error: float = 0.0) -> None:
        """Compile the box of an agent's rate.

        Args:
            dynamics: the agent's.
            bound: φ_l^max, with whatever else its motion may be off by.
            error: bound on the norm of a sensor's error in each sample.

        Raises:
            UnboundedOperationError: the dynamics have no interval extension.
        """
        self._bound, self._error = bound, error
        self._rates = _rates(dynamics, bound, error)

    @np.errstate(over="ignore", invalid="ignore")  # in windows of 5e-324 s a rate may overflow
    def excess(self, before: Array, after: Array, u: Array, seconds: Array) -> Array:
        """Return by how much more than φ_l^max it takes to explain each window, shape (w,).

        Above 0: convicted. -inf where no box is proven: no conviction.

        Args:
            before: first samples, shape (w, n).
            after: second samples, shape (w, n).
            u: the announced input of each part, shape (w, s, m).
            seconds: length of each part [s], shape (w, s); a part that a window lacks has 0.
        """
        (w, parts, _), n = u.shape, before.shape[1]
        times = seconds.sum(axis=1)
        ends = np.concatenate([before, u.min(axis=1), u.max(axis=1)], axis=1)
        rows = np.concatenate([np.repeat(ends, parts, axis=0), u.reshape(w * parts, -1)], axis=1)
        rows = np.column_stack([rows, np.repeat(times, parts)])
        rates = self._rates(rows.ravel(), np.arange(rows.size).reshape(rows.shape))
        box = rates.reshape(w, parts, -1)
        shares = (seconds / times[:, None])[..., None]
        low, high = ((shares * side).sum(axis=1) for side in (box[..., :n], box[..., n:-1]))
        moved = (after - before) / times[:, None]
        outside = np.maximum(0.0, np.maximum(low - moved, moved - high))
        size = 1.0 + np.abs(before).max(axis=1) + np.abs(moved).max(axis=1)
        ends_of = LEAST + np.abs(before).sum(axis=1) + np.abs(after).sum(axis=1)
        off = 2.0 * self._error + _ROUNDED * (seconds > 0.0).sum(axis=1) * ends_of
        allowed = self._bound * (1.0 + _ROUNDING) + _ROUNDING * size + off / times
        beyond = np.sqrt((outside * outside).sum(axis=1)) - allowed
        proven = (box[..., -1] > 0.5).all(axis=1) & np.isfinite(beyond)
        return np.where(proven, beyond, -np.inf)


@outwards()
def _rates(dynamics: Dynamics, bound: float, error: float) -> MappedFunction:
    """(x(0), least and largest input, one input, T) -> the box of f + g u over B, and its proof."""
    x = ca.SX.sym("x", len(dynamics.states))
    least, most, held = (ca.SX.sym(name, len(dynamics.inputs)) for name in ("lo", "hi", "u"))
    horizon, u = ca.SX.sym("T"), ca.SX.sym("w", held.numel())
    rate, symbols = (
        dynamics.drift(x) + dynamics.actuation(x) @ u,
        [*ca.vertsplit(x), *ca.vertsplit(u)],
    )
    allowed = [Interval(a, b) for a, b in zip(*map(ca.vertsplit, (least, most)), strict=True)]
    pushed, off = (Interval(ca.SX(-size), ca.SX(size)) for size in (bound, error))
    starts = [add(point(component), off) for component in ca.vertsplit(x)]

    def after(box: Sequence[Interval]) -> list[Interval]:
        rates = [add(r, pushed) for r in extend(ca.vertsplit(rate), symbols, [*box, *allowed])]
        gone = [hull(point(0.0), multiply(point(horizon), r)) for r in rates]
        return [add(start, component) for start, component in zip(starts, gone, strict=True)]

    box = starts
    for extra in _INFLATIONS:
        box = [inflate(hull(a, b), extra, _LEAST) for a, b in zip(starts, after(box), strict=True)]
    final = after(box)
    certain = finite(final)
    for start, a, b in zip(starts, final, box, strict=True):
        within = ca.logic_and(b.lo < start.lo, start.hi < b.hi)
        certain = ca.logic_and(certain, ca.logic_and(within, inside(a, b)))
    box_rates = extend(ca.vertsplit(rate), symbols, [*final, *map(point, ca.vertsplit(held))])
    low, high = (ca.vertcat(*side) for side in zip(*box_rates, strict=True))
    return MappedFunction([x, least, most, held, horizon], [low, high, certain])
