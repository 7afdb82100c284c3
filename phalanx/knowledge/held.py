"""Motion under a held input, with drag: its factors, to the same bits on any machine.

With p' = v and v' = u - β v, after a time t of one input::

    v(t) = e^{-βt} v + k u             k = (1 - e^{-βt}) / β   (t without drag)
    p(t) = p + k v + r u               r = (t - k) / β         (t²/2 without drag)

All three factors are >= 0: the largest p and v come from the largest start and input.
"""

from typing import NamedTuple

import numpy as np

from phalanx.theory.arrays import Array

_HALVINGS = 7
_TERMS = 12
_SETTLED = 40.0
"""βt after which e^{-βt} is lost in rounding: the speed no longer changes."""


class Held(NamedTuple):
    """Factors of a motion under one input, each of the shape of the times."""

    decay: Array
    """e^{-βt}"""
    speed: Array
    """k [s]"""
    reach: Array
    """r [s²]"""


def held(drag: Array, time: Array) -> Held:
    """Compute the factors; by a series for 1/128 of the time, which is then doubled.

    Args:
        drag: β >= 0 [1/s]. time: t >= 0 [s], of a shape that goes with it.

    >>> held(np.array([0.5]), np.array([2.0])).decay
    array([0.36787944])
    """
    if not np.any(drag):
        return Held(np.ones_like(time), time, 0.5 * time * time)
    with np.errstate(divide="ignore"):
        moving = np.minimum(time, _SETTLED / drag)
    part = moving * 2.0**-_HALVINGS
    x = drag * part
    series = np.ones_like(x)
    for n in range(_TERMS, 2, -1):
        series = 1.0 - x / n * series
    reach = 0.5 * part * part * series
    speed = part - drag * reach
    decay = 1.0 - drag * speed
    for _ in range(_HALVINGS):
        reach = 2.0 * reach + speed * speed
        speed = speed * (1.0 + decay)
        decay = decay * decay
    return Held(decay, speed, reach + speed * (time - moving))


def jumped(time: Array) -> Held:
    """Return the factors where inputs are velocities, of a state (p, 0): p(t) = p + t u."""
    return Held(np.ones_like(time), np.zeros_like(time), time)


def halves(x: Array) -> tuple[Array, Array]:
    """Return the two halves of a state, or of an error of one: p and v, shapes (..., axes)."""
    axes = x.shape[-1] // 2
    return x[..., :axes], x[..., axes:]


def moved(x: Array, u: Array, factors: Held) -> Array:
    """Return the state (p, v) after an input.

    Args:
        x: shape (..., 2 axes). u: shape (..., axes), or one number for all.
        factors: shapes (..., 1).
    """
    p, v = halves(x)
    there = p + factors.speed * v + factors.reach * u
    return np.concatenate([there, factors.decay * v + factors.speed * u], axis=-1)
