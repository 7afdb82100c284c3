"""Inputs that try to break a bound, and the exact motion under them."""

from collections.abc import Iterator

import numpy as np

from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion, stacked
from phalanx.knowledge.sets import Boxes, HeardState, enclosures


def draw_motion(rng: np.random.Generator, disturbance: float = 0.0) -> PointMotion:
    """A motion in the plane or in space, with drag or without."""
    longest = float(rng.uniform(0.02, 0.1))
    return PointMotion(
        axes=int(rng.integers(2, 4)),
        acceleration=float(rng.uniform(1.0, 6.0)),
        drag=float(rng.choice([0.0, 0.3, 1.5])),
        disturbance=disturbance,
        longest=longest,
        shortest=float(rng.uniform(0.3, 0.9)) * longest,
    )


def draw_inputs(kind: str, count: int, motion: PointMotion, rng: np.random.Generator):
    """Inputs of equal parts, at random, or at the bounds with few changes; (count, axes)."""
    bound, axes = motion.authority, motion.axes
    if kind == "random":
        return rng.uniform(-bound, bound, (count, axes))
    begin, end = (bound * rng.choice([-1.0, 1.0], axes) for _ in range(2))
    changes = rng.integers(0, count + 1, axes)
    return np.where(np.arange(count)[:, None] < changes, begin, end)


def path(x: np.ndarray, inputs: np.ndarray, time: float, drag: float) -> Iterator[np.ndarray]:
    """States (p, v) after each of these inputs, which hold for equal parts of a time."""
    factors = held(np.array([drag]), np.array([time / len(inputs)]))
    for u in inputs:
        x = moved(x, u, factors)
        yield x


def gap(own: np.ndarray, peer: np.ndarray, a: PointMotion, b: PointMotion, radius: float) -> float:
    """-V of two references."""
    axes = a.axes
    apart = np.linalg.norm(own[:axes] - peer[:axes])
    ways = (m.stopping(np.linalg.norm(z[axes:])) for m, z in ((a, own), (b, peer)))
    return apart - radius - a.tube - b.tube - sum(ways)


def enclosed(z: np.ndarray, age: float, motion: PointMotion, **options) -> Boxes:
    """The box of one peer a time after it was at z."""
    state = HeardState(0.0, z, z, 0.0, np.zeros(motion.axes))
    return enclosures([state], np.array([age]), stacked([motion]), **options)
