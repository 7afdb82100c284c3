"""An agent's motion as others know it: bounds, the way that it needs to stop, and its brake."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, sqrt
from typing import ClassVar, NamedTuple

import numpy as np

from phalanx.knowledge.held import Held, held, jumped
from phalanx.knowledge.tracking import Tracking, tracking
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.polytope import Polytope, polytope


@dataclass(frozen=True)
class PointMotion:
    """p' = v + φ_p, v' = u - β v + φ_v with |u_k| <= acceleration and ‖φ‖ <= disturbance, sampled.

    In the plane or in space. Errors are those with which the agent measures its own state.

    >>> PointMotion(2, 4.0, 0.0, 0.0, longest=0.05, shortest=0.02).stopping(2.0)
    0.6
    """

    axes: int
    acceleration: float
    """Bound on every component of the input [m/s²]."""
    drag: float
    """β [1/s]"""
    disturbance: float
    """Bound on the norm of the rates' disturbance φ."""
    longest: float
    """τ: longest time from a sample to the end of its input [s]."""
    shortest: float
    """Shortest time for which an input is held [s]."""
    position_error: float = 0.0
    """Bound [m]."""
    speed_error: float = 0.0
    """Bound [m/s]."""
    jumps: ClassVar[bool] = False
    """Its inputs are no velocities."""

    @cached_property
    def tracking(self) -> Tracking:
        """Gains K, and the tube around a reference. Raises ValueError if φ is too large."""
        clock = self.longest, self.shortest
        errors = self.position_error, self.speed_error
        return tracking(self.drag, self.disturbance, *clock, self.acceleration, *errors)

    @property
    def push(self) -> float:
        """Bound on every component of the input and of φ together [m/s²]."""
        return self.authority + self.reserve + self.disturbance

    @cached_property
    def inputs(self) -> Polytope:
        """The inputs that tracking leaves to the reference."""
        faces = np.concatenate([np.eye(self.axes), -np.eye(self.axes)])
        return polytope(faces, np.full(len(faces), self.authority))

    @cached_property
    def authority(self) -> float:
        """A: all of the acceleration that tracking leaves to the reference [m/s²]."""
        return self.acceleration - self.reserve

    @property
    def reserve(self) -> float:
        """Bound on every component of the input that tracking takes [m/s²]."""
        return self.tracking.reserve

    @cached_property
    def tube(self) -> float:
        """ρ: bound on the distance of the position from its reference [m]."""
        return self.tracking.tube

    def held(self, time: Array) -> Held:
        """The factors of a state (p, v) under one input, of the shape of the times."""
        return held(np.array(self.drag), time)

    def stopping(self, speed: float) -> float:
        """L = v²/2A + τ v: the way on which it stops, its next sample being a τ away [m]."""
        return speed * speed / (2.0 * self.authority) + self.longest * speed

    def rate(self, speed: float, time: float) -> float:
        """Bound on how fast an own part changes a gap within a time from some speed [m/s]."""
        change = self.authority * sqrt(self.axes) + self.drag * speed
        speed += change * time
        return speed + change * (speed / self.authority + self.longest)

    def brake(self, v: Array) -> Array:
        """The input that stops after m longest holds, along the velocity; shape (axes,).

        With a in m holds, L' + ‖v‖ <= 0 all the time, for whatever direction others are in: on
        the way to rest a = ‖v'‖ >= ‖v‖ A / (‖v‖ + A τ), as m τ <= ‖v(0)‖ / A + τ.
        """
        speed = float(length(v))
        count = max(1, ceil(speed / (self.authority * self.longest)))
        factors = self.held(np.array(count * self.longest))
        bound = self.authority
        return np.minimum(np.maximum(v * -(factors.decay / factors.speed), -bound), bound)

    def on_the_way(self, v: Array, u: Array, factors: Held) -> Array:
        """Velocities p' of n holds after m times; shape (n, m, axes)."""
        path: Array = factors.decay[..., None] * v[:, None] + factors.speed[..., None] * u[:, None]
        return path


Motion = PointMotion | VelocityMotion
"""Of one order in a swarm: all agents' inputs are velocities, or none's."""


class Motions(NamedTuple):
    """Bounds of several agents' references, stacked."""

    drag: Array
    """β, shape (n, 1)."""
    authority: Array
    """A, shape (n, 1)."""
    longest: Array
    """τ, shape (n,)."""
    tube: Array
    """ρ, shape (n,)."""
    shortest: Array
    """Shortest time for which an input is held, shape (n,)."""
    reserve: Array
    """Of the input for tracking, shape (n, 1)."""
    jumps: Array
    """1 where inputs are velocities, else 0; shape (n, 1)."""

    def held(self, time: Array) -> Held:
        """Factors of states (p, v) under one input, for times of shape (n, 1)."""
        return jumped(time) if self.jumps.any() else held(self.drag, time)

    def stopping(self, speed: Array) -> Array:
        """L of each, shape (n,)."""
        way: Array = speed * speed / (2.0 * self.authority[:, 0]) + self.longest * speed
        return way

    def of(self, indices: Sequence[int] | Index) -> "Motions":
        """Return some of them, in this order."""
        rows = np.asarray(indices, dtype=np.intp)
        return Motions(*(column[rows] for column in self))


def stacked(motions: Sequence[Motion]) -> Motions:
    """Stack the bounds of several agents."""
    rows = [
        (m.drag, m.authority, m.longest, m.tube, m.shortest, m.reserve, float(m.jumps))
        for m in motions
    ]
    drag, authority, longest, tube, shortest, *inputs = np.array(rows).reshape(-1, 7).T
    reserve, jumps = (column[:, None] for column in inputs)
    return Motions(drag[:, None], authority[:, None], longest, tube, shortest, reserve, jumps)
