"""Inputs that try to break a bound, and the exact motion under them."""

from collections.abc import Iterator

import numpy as np

from phalanx.knowledge.held import moved
from phalanx.knowledge.motion import Motion, PointMotion, stacked
from phalanx.knowledge.sets import Boxes, HeardState, enclosures
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.theory.models.polytope import polytope


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


def box_motion(axes: int, speed: float, *rest: float) -> VelocityMotion:
    """A single integrator; rest: disturbance, turning, longest, shortest."""
    faces = np.concatenate([np.eye(axes), -np.eye(axes)])
    return VelocityMotion(polytope(faces, np.full(2 * axes, speed)), *rest)


def draw_velocity_motion(rng: np.random.Generator) -> VelocityMotion:
    """A single integrator in the plane or in space."""
    longest = float(rng.uniform(0.02, 0.1))
    axes, speed = int(rng.integers(2, 4)), float(rng.uniform(0.5, 4.0))
    return box_motion(axes, speed, 0.0, 0.0, longest, float(rng.uniform(0.3, 0.9)) * longest)


DRAWS = [draw_motion, draw_velocity_motion]


def draw_states(motion: Motion, count: int, rng: np.random.Generator) -> np.ndarray:
    """States of points, shape (count, 2 axes)."""
    z = rng.normal(size=(count, 2 * motion.axes))
    if motion.jumps:
        z[:, motion.axes :] = 0.0
    return z


def draw_inputs(kind: str, count: int, motion: Motion, rng: np.random.Generator):
    """Inputs of equal parts, at random, or at the bounds with few changes; (count, axes)."""
    bound, axes = motion.authority, motion.axes
    if kind == "random":
        return rng.uniform(-bound, bound, (count, axes))
    begin, end = (bound * rng.choice([-1.0, 1.0], axes) for _ in range(2))
    changes = rng.integers(0, count + 1, axes)
    return np.where(np.arange(count)[:, None] < changes, begin, end)


def path(x: np.ndarray, inputs: np.ndarray, time: float, motion: Motion) -> Iterator[np.ndarray]:
    """States (p, v) after each of these inputs, which hold for equal parts of a time."""
    factors = motion.held(np.array([time / len(inputs)]))
    for u in inputs:
        x = moved(x, u, factors)
        yield x


def gap(own: np.ndarray, peer: np.ndarray, a: Motion, b: Motion, radius: float) -> float:
    """-V of two references."""
    axes = a.axes
    apart = np.linalg.norm(own[:axes] - peer[:axes])
    ways = (m.stopping(np.linalg.norm(z[axes:])) for m, z in ((a, own), (b, peer)))
    return apart - radius - a.tube - b.tube - sum(ways)


def enclosed(z: np.ndarray, age: float, motion: Motion, **options) -> Boxes:
    """The box of one peer a time after it was at z."""
    state = HeardState(0.0, z, z, 0.0, np.zeros(motion.axes))
    return enclosures([state], np.array([age]), stacked([motion]), **options)
