"""The fallback *flight* of a unicycle: turn to a heading, then drive straight on or back for ever.

At each sample ω = (θ_1 - θ) / τ within ±Ω, and ν = ±V as soon as |θ_1 - θ| <= Ω τ, else 0. While it
turns, θ comes nearer by at least Ω - φ per second; from then on |θ_1 - θ| stays within Ω τ, and is
within φ τ after holds that each take off a share q = h_min / τ. So the axle moves with
w = ±V n(θ_1), and in addition by at most φ (1 + V τ) per second and V Ω τ / q · τ in all. That is a
chaser's gain: its speed counts as so much more. The turn begins at most τ after a sample and takes

    (|θ_1 - θ| + (|ω| + φ) τ - Ω τ) / (Ω - φ) + τ

where that is needed; meanwhile chasers come nearer, and the axle moves by φ alone.
"""

from collections.abc import Iterator
from math import pi, remainder
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.promise.capsules import Capsules, balls
from phalanx.promise.exit import Chasers
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.wheeled import Unicycle

_HEADINGS = 16


class Flight(NamedTuple):
    """One way out."""

    heading: float
    """θ_1 [rad]"""
    way: float
    """1 straight on, -1 back."""


class Flights:
    """All ways out of one unicycle."""

    def __init__(self, model: Unicycle, disturbance: float, longest: float, shortest: float):
        """disturbance: bound on the norm of φ; longest and shortest: gaps between samples [s].

        Raises ValueError if φ is more than it can turn against.
        """
        if disturbance >= model.turn_rate:
            raise ValueError(
                f"to hold a heading against a disturbance of {disturbance:g} rad/s takes more than "
                f"a turn rate of {model.turn_rate:g}"
            )
        self._model, self._phi, self._tau, self.speed = model, disturbance, longest, model.speed
        self._within = model.turn_rate * longest
        """Angle at which it drives [rad]."""
        self.drift = disturbance * (1.0 + model.speed * longest)
        """What chasers gain by φ [m/s]."""
        self._late = model.speed * self._within * longest * longest / shortest
        angle = ca.SX.sym("theta")
        self._axis = CompiledFunction([angle], [ca.vertcat(ca.cos(angle), ca.sin(angle))])

    def input(self, x: Array, flight: Flight) -> Array:
        """Return the input (ν, ω) of a flight at a sample x = (c, θ)."""
        turn, off = self._model.turn_rate, remainder(flight.heading - float(x[2]), 2.0 * pi)
        if abs(off) > self._within:
            return np.array([0.0, turn if off > 0.0 else -turn])
        return np.array([flight.way * self._model.speed, off / self._tau])

    def ways(self, x: Array) -> Iterator[Flight]:
        """Yield ways to try at a sample: first without a turn."""
        for heading in (float(x[2]), *(2.0 * pi * np.arange(_HEADINGS) / _HEADINGS).tolist()):
            yield Flight(heading, 1.0)
            yield Flight(heading, -1.0)

    def gaps(self, x: Array, u: Array, flight: Flight, others: Chasers) -> Array:
        """Return how far each of the others is at least from the output point [m].

        For ever, or for its time if it is faster.

        Args:
            x: the sampled state.
            u: (ν, ω), held for at most τ before the flight.
            flight: the way out.
            others: chasers, and obstacles, which have no speed; n of them.

        Returns:
            shape (n,).
        """
        model, tau, (nu, omega) = self._model, self._tau, u.tolist()
        turned = (abs(omega) + self._phi) * tau
        axis, ahead = self._axis(float(x[2]))[0], self._axis(flight.heading)[0]
        off = abs(remainder(flight.heading - float(x[2]), 2.0 * pi)) + turned - self._within
        turning = off / (model.turn_rate - self._phi) + tau if off > 0.0 else 0.0
        time, axle = tau + turning, np.array([x[:2], x[:2] + tau * nu * axis])
        radius = 0.5 * abs(nu) * turned * tau + self._phi * time
        near = others.offsets + others.speeds * time
        # Until it drives its output point is ahead of the axle, or anywhere around it.
        front, around = (axis, turned) if off <= 0.0 else (0.0 * axis, 1.0)
        before = _capsule(axle + model.offset * front, radius + model.offset * around)
        gaps = before.gaps(balls(others.places, near))
        after = _capsule(
            axle + model.offset * ahead, radius + model.offset * self._within + self._late
        )
        chasers = Chasers(others.places, near, others.speeds + self.drift, others.times)
        least: Array = np.minimum(gaps, chasers.gaps(after, flight.way * model.speed * ahead))
        return least


def _capsule(ends: Array, radius: float) -> Capsules:
    return Capsules(ends[:1], ends[1:], np.array([radius]))
