"""Tracking of a reference against a disturbance: gains, and the tube in which the state stays.

The reference z = (p, v) moves as the agent would, undisturbed, under an input ū. The applied input
is u = ū - K (x - z), held from sample to sample. The error e = x - z then has, for a rate σ, ::

    e_p' = e_v + φ_p,  e_v' = -2σ² e_p - 2σ e_v + φ_v        K = (2σ², 2σ - β)

if it were sampled all the time. In coordinates (2σ e_p + e_v, e_v) that is a turn and a shrinking
with e^{-σt}, so ‖e‖ is taken in these. Over a gap h it becomes M(h) e + w, ‖w‖ <= w(h), and the
ball of radius r is never left if ‖M(h)‖ r + w(h) <= r for every gap that the clock allows. That is
proved piece by piece: the norm at the middle, and the largest slope of M. Between two samples the
same sum bounds ‖e‖. The σ is chosen that costs least: tube, and what tracking takes of the input.
"""

from functools import cache
from math import sqrt
from typing import NamedTuple

import numpy as np

from phalanx.knowledge.held import Held, halves, held
from phalanx.theory.arrays import Array

_RATES = 32
_SLOWEST, _RATIO = 0.01, 1.15
"""σ is tried from this share of 1/τ on, each so many times the one before."""
_PIECES = 48
_PRICE = 0.25
"""Metres of tube that a reserve of 1 m/s² is worth: what it adds to a stop from A times .7 s."""


class Tracking(NamedTuple):
    """Gains and bounds of an agent that tracks its reference."""

    gains: tuple[float, float] = (0.0, 0.0)
    """K, of position [1/s²] and speed [1/s]."""
    rate: float = 1.0
    """σ [1/s]"""
    radius: float = 0.0
    """r at samples, with what a measured state may be off [m/s]."""
    tube: float = 0.0
    """ρ: bound on ‖e_p‖ at any time [m]."""
    speed_tube: float = 0.0
    """Bound on ‖e_v‖ at any time [m/s]."""
    reserve: float = 0.0
    """Bound on every component of K e [m/s²]."""

    def pull(self, error: Array) -> Array:
        """-K e, shape (axes,), for e of shape (2 axes,)."""
        p, v = halves(error)
        u: Array = -(self.gains[0] * p + self.gains[1] * v)
        return u

    def size(self, error: Array) -> float:
        """‖e‖ in the norm of the tube [m/s]."""
        p, v = halves(error)
        first = 2.0 * self.rate * p + v
        return sqrt(float(np.add.reduce(first * first + v * v)))


@cache
def tracking(
    drag: float,
    disturbance: float,
    longest: float,
    shortest: float,
    acceleration: float,
    position_error: float = 0.0,
    speed_error: float = 0.0,
) -> Tracking:
    """Choose gains for gaps between samples from shortest to longest [s].

    Args:
        drag: β [1/s].
        disturbance: bound on the norm of φ, of the rates of p and v.
        longest: longest gap [s].
        shortest: shortest gap [s].
        acceleration: bound on every component of the input [m/s²].
        position_error: bound on the error of a measured position [m].
        speed_error: likewise [m/s].

    Raises:
        ValueError: it takes more than the acceleration.
    """
    if disturbance == position_error == speed_error == 0.0:
        return Tracking()
    errors, candidates, rate = (position_error, speed_error), [], _SLOWEST / longest
    for _ in range(_RATES):
        error = _Error(drag, rate)
        candidates.append(error.tracking(disturbance, errors, shortest, longest))
        rate *= _RATIO
    best = min(candidates, key=lambda c: c.tube + _PRICE * c.reserve)
    if best.reserve >= acceleration:
        least = min(candidate.reserve for candidate in candidates)
        if least >= acceleration:
            raise ValueError(
                f"to hold a place against a disturbance of {disturbance:g} takes {least:.3g} m/s² "
                f"of each input, which has {acceleration:g}"
            )
        best = min(candidates, key=lambda c: c.reserve)
    return best


class _Error(NamedTuple):
    """The error's motion with a rate σ."""

    drag: float
    rate: float

    @property
    def gains(self) -> tuple[float, float]:
        return 2.0 * self.rate * self.rate, 2.0 * self.rate - self.drag

    def tracking(
        self, disturbance: float, errors: tuple[float, float], shortest: float, longest: float
    ) -> Tracking:
        """The bounds; infinite where no ball is kept for all gaps."""
        pull = self.gains[0] * errors[0] + abs(self.gains[1]) * errors[1]
        ends = np.array([shortest + (longest - shortest) * n / _PIECES for n in range(_PIECES + 1)])
        shrinking = 1.0 - self._growth(ends)
        if not (shrinking > 0.0).all():
            return Tracking(self.gains, self.rate, *4 * [np.inf])
        start = sqrt((2.0 * self.rate * errors[0] + errors[1]) ** 2 + errors[1] ** 2)
        pushed = self._pushed(ends[1:], disturbance, pull)
        radius = max(start, float((pushed / shrinking).max()))
        # Between samples, also before the shortest gap is over.
        times = np.array([longest * n / _PIECES for n in range(_PIECES + 1)])
        largest = self._growth(times) * radius + self._pushed(times[1:], disturbance, pull)
        widest, turn = float(largest.max()), self.rate - self.drag
        return Tracking(
            gains=self.gains,
            rate=self.rate,
            radius=radius + start,
            tube=widest * sqrt(0.5) / self.rate,
            speed_tube=widest,
            reserve=radius * sqrt(self.rate * self.rate + turn * turn) + pull,
        )

    def _growth(self, ends: Array) -> Array:
        """The largest ‖M‖ between each two of these times, shape (pieces,)."""
        begin, end = ends[:-1], ends[1:]
        first, last = held(np.array(self.drag), begin), held(np.array(self.drag), end)
        middle = held(np.array(self.drag), 0.5 * (begin + end))
        stiff, damping = self.gains
        # M' = e^{-βt} D + k E: e^{-βt} falls and k rises.
        slope = first.decay * self._norm(0.0, 1.0, -stiff, -self.drag - damping)
        slope = slope + last.speed * self._norm(-stiff, -damping, 0.0, 0.0)
        k, r = middle.speed, middle.reach
        at_middle = self._norm(
            1.0 - r * stiff, k - r * damping, -k * stiff, middle.decay - k * damping
        )
        growth: Array = at_middle + 0.5 * (end - begin) * slope
        return growth

    def _pushed(self, times: Array, disturbance: float, pull: float) -> Array:
        """w: what φ, and errors of a measured state, add to ‖e‖ within these times."""
        factors, twice = held(np.array(self.drag), times), 2.0 * self.rate
        # ‖e^{As} φ‖ is convex in k(s), and ∫ k is the reach.
        begin = _largest_singular_value(twice, 1.0, 0.0, 1.0)
        decay, k, reach = factors
        end = _largest_singular_value(twice, twice * k + decay, 0.0 * k, decay)
        mean = begin * times + (end - begin) * reach / k
        return disturbance * mean + _reached(factors, twice) * pull

    def _norm(
        self, a: Array | float, b: Array | float, c: Array | float, d: Array | float
    ) -> Array:
        """The norm of a matrix ((a, b), (c, d)), in the tube's coordinates."""
        twice = 2.0 * self.rate
        first, second = twice * a + c, twice * b + d
        return _largest_singular_value(
            first / twice, second - first / twice, c / twice, d - c / twice
        )


def _largest_singular_value(
    a: Array | float, b: Array | float, c: Array | float, d: Array | float
) -> Array:
    squares, determinant = a * a + b * b + c * c + d * d, a * d - b * c
    rest = np.maximum(0.0, squares * squares - 4.0 * determinant * determinant)
    value: Array = np.sqrt(0.5 * (squares + np.sqrt(rest)))
    return value


def _reached(factors: Held, twice: float) -> Array:
    """‖e‖ of what an input of 1 m/s² leads to."""
    first = twice * factors.reach + factors.speed
    size: Array = np.sqrt(first * first + factors.speed * factors.speed)
    return size
