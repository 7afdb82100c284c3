"""The disturbance that explains a motion under the declared model.

Between two instants an agent moves from x(0) to x(T) and holds u. The ledger's entry is the
constant φ̂ for which the motion of x' = f(x) + g(x) u + φ̂ from x(0) ends at x(T). It is an
explanation, so the least bound on φ that explains the motion is not above ‖φ̂‖. *A constant φ* is
found itself. *Any other*: to first order in T the entry is the mean of φ, so for φ linear in t the
largest ‖φ(t)‖ is above ‖φ̂‖ by at most half of what φ changes by in the interval.

Entries are rounded up: they include what is left of x(T) after the last iteration, rounding, and
the error of an integration with twenty steps, by its difference from one with ten.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Dynamics, weighted_rates

_STEPS = 10
_ITERATIONS = 20
"""Each divides the error by about 12 / (T ‖J‖)², with J the Jacobian of f + g u."""
_ROUNDED = 2.0**-46
"""Rounding error of a state after some hundred integration steps, relative to the state."""


class Explanation(NamedTuple):
    """Disturbances that explain w motions."""

    phi: Array
    """φ̂ of each, every component rounded away from zero, shape (w, n)."""
    size: Array
    """‖φ̂‖, shape (w,); infinite where no φ̂ is found."""


class DisturbanceLedger:
    """The explanations of motions of agents with one dynamics."""

    def __init__(self, dynamics: Dynamics) -> None:
        """Compile the motion under a constant disturbance."""
        n, m = len(dynamics.states), len(dynamics.inputs)
        x, end, phi, u = (ca.SX.sym(*s) for s in (("x", n), ("end", n), ("phi", n), ("u", m)))
        horizon, rate = ca.SX.sym("T"), dynamics.drift(x) + dynamics.actuation(x) @ u
        field = ca.Function("f", [x, u], [rate])
        coarse, fine = (_reached(field, x, u, phi, horizon, k * _STEPS) for k in (1, 2))
        error = (fine - coarse) / 15  # of the finer, to the leading order in its step
        residual = end - fine - error
        once = horizon * ca.jtimes(rate, x, residual)
        twice = horizon * ca.jtimes(rate, x, once)
        # The inverse of ∂x(T)/∂φ = T (1 + TJ/2 + ...), to second order.
        better = phi + (residual - once / 2 + twice / 12) / horizon
        doubt = ca.fabs(residual) + ca.fabs(error)
        self._improve = MappedFunction([x, end, u, horizon, phi], [better, doubt])

    def explain(self, before: Array, after: Array, u: Array, seconds: Array) -> Explanation:
        """Explain w motions.

        Args:
            before: first states, shape (w, n).
            after: last states, shape (w, n).
            u: the input held in between, shape (w, m).
            seconds: length of each motion [s], above 0, shape (w,).
        """
        w, n = before.shape
        motions = np.concatenate([before, after, u, seconds[:, None]], axis=1)
        phi, last, doubt = np.zeros((3, w, n))
        rounded = _ROUNDED * (np.abs(before) + np.abs(after))
        moving = np.arange(w)
        for _ in range(_ITERATIONS):
            row = np.concatenate([motions[moving], phi[moving]], axis=1)
            improved = self._improve(row.ravel(), np.arange(row.size).reshape(row.shape))
            last[moving] = phi[moving]
            phi[moving], doubt[moving] = np.split(improved, 2, axis=1)
            change = np.abs(phi[moving] - last[moving]) * seconds[moving, None]
            moving = moving[(change > rounded[moving]).any(axis=1)]
            if not len(moving):
                break
        phi = last + np.copysign((doubt + rounded) / seconds[:, None], last)
        size = length(phi)
        return Explanation(phi, np.where(np.isfinite(size), size, np.inf))


def _reached(
    field: ca.Function, x: ca.SX, u: ca.SX, phi: ca.SX, horizon: ca.SX, steps: int
) -> ca.SX:
    """x(T) under a constant disturbance, by this many steps."""
    dt = horizon / steps
    for _ in range(steps):
        x = x + dt / 6 * weighted_rates(field, x, u, (phi, phi, phi), dt)
    return x
