"""The motion of an agent whose inputs are velocities, as others know it: it needs no way to stop.

Its state is (p, 0), p the output point. The reference z moves with a velocity w, held from sample
to sample. The applied input gives p, at the sampled heading, the velocity w - K e, e = p - z; after
a time h <= τ e is (1 - K h) e + d. The heading turns by at most Ω h meanwhile, and with it a
velocity of at most s, so ‖d‖ <= φ h + ½ Ω s h² <= φ' h with φ' = φ + ½ Ω s τ. With K τ <= 1 the
ball of radius φ' / K is kept, at samples and between them, and K e is at most φ'.
"""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import ClassVar

import numpy as np

from phalanx.knowledge.held import Held, jumped
from phalanx.knowledge.tracking import Tracking
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.polytope import Polytope, polytope

_PRICE = 0.25
"""Metres of tube that a reserve of 1 m/s is worth [s]."""


@dataclass(frozen=True, eq=False)
class VelocityMotion:
    """p' = v + φ, v in a set that a heading may turn, ‖φ‖ <= disturbance, sampled.

    >>> square = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    >>> VelocityMotion(square, disturbance=0.1, turning=0.0, longest=0.05, shortest=0.02).tube
    0.005000000000000001
    """

    velocities: Polytope
    """The set at heading 0, which has 0 inside [m/s]."""
    disturbance: float
    """Bound on the norm of φ [m/s]."""
    turning: float
    """Ω: bound on how fast the heading turns, 0 without one [rad/s]."""
    longest: float
    """τ: longest time from a sample to the end of its input [s]."""
    shortest: float
    """Shortest time for which an input is held [s]."""
    position_error: float = 0.0
    """Bound on the error of its own measured output point [m]."""
    drag: ClassVar[float] = 0.0
    speed_error: ClassVar[float] = 0.0
    jumps: ClassVar[bool] = True
    """Its inputs are velocities."""

    @property
    def axes(self) -> int:
        return int(self.velocities.A.shape[1])

    @cached_property
    def tracking(self) -> Tracking:
        """Gain K, and the tube around a reference. Raises ValueError if φ' is too large."""
        pushed = self.disturbance + 0.5 * self.turning * self.fastest * self.longest
        gain, error = 1.0 / self.longest, self.position_error
        if error > 0.0:
            gain = min(gain, sqrt(pushed / (2.0 * error * _PRICE)))
        tube = error + (pushed / gain if pushed > 0.0 else 0.0)
        reserve, least = pushed + 2.0 * gain * error, float(self.velocities.b.min())
        if reserve >= least:
            raise ValueError(
                f"to hold a place against a disturbance of {self.disturbance:g} m/s, and turns of "
                f"{self.turning:g} rad/s, takes {reserve:.3g} m/s in each direction; in one of "
                f"them it has {least:.3g}"
            )
        speed_tube = self.push + self.disturbance
        return Tracking((gain, 0.0), 0.5, tube + error, tube, speed_tube, reserve)

    @cached_property
    def inputs(self) -> Polytope:
        """The velocities that tracking leaves to the reference, at heading 0."""
        return polytope(self.velocities.A, self.velocities.b - self.reserve)

    @cached_property
    def fastest(self) -> float:
        """s: bound on the norm of the velocity without φ [m/s]."""
        return _fastest(self.velocities)

    @cached_property
    def authority(self) -> float:
        """Bound on every component of the reference's velocity, at any heading [m/s]."""
        return self._largest(self.inputs)

    @cached_property
    def push(self) -> float:
        """Bound on every component of the velocity, at any heading [m/s]."""
        return self._largest(self.velocities)

    @property
    def reserve(self) -> float:
        """Bound on the velocity that tracking takes [m/s]."""
        return self.tracking.reserve

    @property
    def tube(self) -> float:
        """ρ: bound on the distance of the output point from its reference [m]."""
        return self.tracking.tube

    def held(self, time: Array) -> Held:
        """The factors of a state (p, 0) under one input, of the shape of the times."""
        return jumped(time)

    def stopping(self, speed: float) -> float:
        """L = 0."""
        return 0.0

    def rate(self, speed: float, time: float) -> float:
        """Bound on how fast an own part changes a gap [m/s]."""
        return self._rate

    def brake(self, v: Array) -> Array:
        """The input that stands; shape (axes,)."""
        return np.zeros_like(v)

    def on_the_way(self, v: Array, u: Array, factors: Held) -> Array:
        """Velocities p' of n holds after m times; shape (n, m, axes)."""
        return np.broadcast_to(u[:, None], (*factors.reach.shape, u.shape[-1]))

    @cached_property
    def _rate(self) -> float:
        return _fastest(self.inputs)

    def _largest(self, velocities: Polytope) -> float:
        """The largest component of these, at any heading."""
        if self.turning > 0.0:
            return _fastest(velocities)
        return float(np.abs(velocities.corners).max())


def _fastest(velocities: Polytope) -> float:
    return float(length(velocities.corners).max())
