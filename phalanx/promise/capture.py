"""Capture: by when a member can have come too near, whatever the other does or its filter decides.

All of it is for a pursuer j whose input may change at once, as certificates count it, and for φ_i
and φ_j that serve it. Let r = p_i - p_j and n = r / ‖r‖.

*Single integrators.* With the u of U_j that is farthest along n, ‖r‖' <= -c, where

    c = min over n of σ_j(n) - σ_i(n) + φ_i + φ_j, and σ(n) = max over u of n·u = s ‖n‖₁.

If c > 0, ‖r‖ is R by (‖r‖ - R) / c.

*Double integrators with the same drag β.* s = r + r'/β obeys s' = (u_i - u_j + φ_i - φ_j) / β, so
it is a single integrator's r. And r' = β (s - r), so that ‖r‖' <= β (‖s‖ - ‖r‖). While ‖s‖ falls by
c per second, ‖r‖ <= ‖s‖ + c/β + (‖r(0)‖ - ‖s(0)‖ - c/β) e^(-βt); then it decays by itself.
"""

from math import exp, log, sqrt
from typing import NamedTuple

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator

_BISECTIONS = 60


class Capture(NamedTuple):
    """Bounds on what one member can do to another.

    >>> slow, fast = SingleIntegrator(speed=1.0), SingleIntegrator(speed=2.0)
    >>> round(capture(slow, fast, phi=0.0).closing, 3)
    1.0
    """

    closing: float
    """c, the speed at which it comes nearer at least [m/s]; if not above 0 nothing is shown."""
    drag: float
    """β [1/s]; 0 for single integrators."""
    outrun: float
    """Sum of both bounds on φ above which c > 0."""

    def time(self, x_i: Array, x_j: Array, radius: float) -> float:
        """Return by when ‖r‖ is at most R, from states of both [s].

        radius: R [m], above 0. Infinite where c is not above 0.
        """
        if self.closing <= 0.0:
            return float("inf")
        if not self.drag:
            return max(0.0, float(length(x_i - x_j)) - radius) / self.closing
        axes = len(x_i) // 2
        r, w = x_i[:axes] - x_j[:axes], x_i[axes:] - x_j[axes:]
        return self._with_drag(float(length(r)), float(length(r + w / self.drag)), radius)

    def _with_drag(self, r: float, s: float, radius: float) -> float:
        """Return the same from ‖r‖ and ‖s‖ at the start."""
        late, drag, until = self.closing / self.drag, self.drag, s / self.closing

        def bound(t: float) -> float:
            return s - self.closing * t + late + (r - s - late) * exp(-drag * t)

        if r <= radius:
            return 0.0
        if (last := bound(until)) > radius:
            return until + log(last / radius) / drag
        low, high = 0.0, until
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if bound(middle) <= radius else (middle, high)
        return high


def capture(fleeing: Dynamics, pursuing: Dynamics, phi: float) -> Capture | None:
    """Return what a member can do; phi: the sum of both bounds on φ. None for other dynamics."""
    match fleeing, pursuing:
        case SingleIntegrator(), SingleIntegrator():
            faster, drag = pursuing.speed - fleeing.speed, 0.0
        case DoubleIntegrator(), DoubleIntegrator() if fleeing.drag == pursuing.drag > 0.0:
            faster, drag = pursuing.acceleration - fleeing.acceleration, fleeing.drag
        case _:
            return None
    # ‖n‖₁ is between 1 and √d.
    least = faster * (1.0 if faster > 0.0 else sqrt(fleeing.dimension))
    return Capture((least + phi) / (drag or 1.0), drag, -least)
