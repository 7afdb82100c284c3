"""Certified times of pairs: h stays at or below 0 that long after an agent applied its input."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.safety.composition import ComposedSet
from phalanx_certify.checker.interval_function import IntervalFunction
from phalanx_certify.checker.intervals import (
    Interval,
    add,
    dot,
    multiply,
    norm,
    point,
    stack,
    total,
)
from phalanx_certify.checker.motions import GroupMotion, Motion

_HORIZONS = ((8.0, (1,)), (4.0, (1,)), (2.0, (1,)), (1.0 + 1e-9, (1, 4, 16)))
"""Horizons to try, in multiples of the longest planned time between two inputs of an agent; and the
numbers of pieces to try for each. The last is slightly above 1, as ends are rounded down."""


class PairBound:
    """Bounds of h and of its rate, for all pairs of one kind."""

    def __init__(self, alone: ComposedSet, motions: Sequence[GroupMotion]) -> None:
        """Compile the bounds from one pair and its members' motions. Raises UndecidedError."""
        self._parts, self._motions = alone.parts, motions
        x, fields = alone.x, [m.dynamics for m in alone.members]
        u = ca.SX.sym("u", sum(len(d.inputs) for d in fields))
        agents = [(d, x[part]) for d, part in zip(fields, alone.parts, strict=True)]
        drift = ca.vertcat(*[d.drift(state) for d, state in agents])
        actuation = ca.diagcat(*[d.actuation(state) for d, state in agents])
        gradient = ca.jacobian(alone.h, x)
        rate = gradient @ (drift + actuation @ u)
        self._now = IntervalFunction([x], [alone.h, gradient @ drift, gradient @ actuation])
        self._within = IntervalFunction([x, u], [alone.h, gradient, ca.jacobian(rate, x)])

    def horizons(self, side: int, x: Array, u: Array) -> Array:
        """Time for which h <= 0 is certain [s], shape (s,); -inf where it is not certain now.

        side: of the agent in the pair, 0 or 1. x: states of both members when it applies its
        input u, shapes (n, s) and (m, s).
        """
        horizons = np.full(x.shape[1], -np.inf)
        for multiple, pieces in _HORIZONS:
            T = multiple * self._motions[side].longest
            todo = np.flatnonzero(horizons < T)
            if todo.size:
                tried = self._tried(side, x[:, todo], u[:, todo], T, pieces)
                horizons[todo] = np.maximum(horizons[todo], tried)
        return horizons

    def _tried(self, side: int, x: Array, u: Array, T: float, pieces: tuple[int, ...]) -> Array:
        """Return the same up to T."""
        spans = np.full(x.shape[1], T)
        inputs = [
            point(u) if l == side else motion.anywhere(len(spans))
            for l, motion in enumerate(self._motions)
        ]
        motions = [
            motion.moved(x[part], applied, spans, pieces)
            for motion, part, applied in zip(self._motions, self._parts, inputs, strict=True)
        ]
        return self._certain(x, motions, stack(inputs), spans)

    def _certain(self, x: Array, motions: Sequence[Motion], u: Interval, T: Array) -> Array:
        (h, drift, actuation), now = self._now(point(x))
        box, rates = stack([m.box for m in motions]), stack([m.rates for m in motions])
        (_, gradient, growth), within = self._within(box, u)
        proven = np.logical_and.reduce([now, within, *[m.proven for m in motions]])
        rate = add(add(drift[0], dot(actuation, u)), self._pushed(gradient)).hi
        bend = np.maximum(add(dot(growth, rates), self._pushed(growth)).hi, 0.0)
        return np.where(proven, _lasting(h[0].hi, rate, bend, T), -np.inf)

    def _pushed(self, gradient: Interval) -> Interval:
        """Bound of the disturbances' effect on a rate with this gradient, shape (s,)."""
        parts = zip(self._parts, self._motions, strict=True)
        return total(
            stack([multiply(norm(gradient[p]), point(m.disturbance))[None] for p, m in parts])
        )


def _lasting(h: Array, rate: Array, bend: Array, T: Array) -> Array:
    """The largest t <= T found with h + t rate + ½ t² bend <= 0, where h <= 0; -inf if none."""
    steepest = rate + np.sqrt(rate * rate - 2.0 * bend * h)
    # The bound's zero, moved a little earlier for rounding; the check below decides.
    zero = np.where(steepest > 0.0, -2.0 * h / steepest * (1.0 - 1e-9), T)
    lasting = np.full_like(T, -np.inf)
    for t in (np.minimum(zero, T), T):
        at = point(t)
        slope = add(point(rate), multiply(point(0.5 * bend), at))
        bound = add(point(h), multiply(at, slope)).hi
        lasting = np.where((h <= 0.0) & (bound <= 0.0), t, lasting)
    return lasting
