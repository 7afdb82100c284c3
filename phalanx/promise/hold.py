"""The fallback *hold*: stop, then stay in a ball around the place, whatever disturbs.

An agent is a point x = (p, v), as peers by radio know it. It keeps the input u that it has to its
next sample, at most τ later, and then its reference z starts at x and brakes: with A of the inputs
it stops on the way L(v) = v²/2A + τ v, straight on, and tracking keeps p within the tube ρ of z. By
`PointMotion.brake` L' + ‖v‖ <= 0 at every moment, also where samples come early. So the reference
never leaves the segment from z to

    e(z) = z_p + z_v (‖z_v‖ / 2A + τ),

and the segments of later references lie in those of earlier ones. *T* is the union of the segments
of x(h) + φ, h <= τ, with ρ around. *W* is what others must expect of an agent at x: any input, any
time left of its hold, or any reference z of which x is within the tubes. Where inputs are
velocities L = 0, and e(z) = z.
"""

from dataclasses import dataclass
from functools import cached_property
from math import hypot, log, sqrt
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from phalanx.knowledge.held import halves, moved
from phalanx.knowledge.motion import Motion, PointMotion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.promise.capsules import Capsules, balls
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length

FloatT = TypeVar("FloatT", float, Array)
_PIECES = 8
"""Parts of a hold, each with its capsule."""
STILL = 0.01
"""Speed of a reference at which it counts as at rest [m/s]."""


class Reference(NamedTuple):
    """A fallback under way: the reference at a sample, and its input until the next."""

    t: float
    z: Array
    """(p, v), shape (2 axes,)."""
    u: Array
    """shape (axes,)"""


class Fallback(Protocol):
    """The motion that an agent can always go on with, and what it and others need to know of it."""

    @property
    def motion(self) -> Motion:
        """The agent's, whose tracking holds the reference."""

    def tube(self, x: Array, u: Array) -> Capsules:
        """T: where it is from now on, with the input u to its next sample, then its fallback."""

    def extent(self, x: Array, u: Array) -> float:
        """Bound on how far T reaches from where it is, so much faster to compute [m]."""

    def expected(self, x: Array) -> Capsules:
        """W of agents at x, shape (n, 2 axes): where each will be, input and reference unknown."""

    def rest_time(self, x: Array, u: Array) -> float:
        """Longest time until its reference is at rest, if it applies u and then stops [s]."""


@dataclass(frozen=True)
class HoldPlace:
    """Hold of an agent whose inputs are velocities.

    From x the output point moves by u h, and by at most φ' h across. The next reference is where
    it then is.
    """

    motion: VelocityMotion

    def tube(self, x: Array, u: Array) -> Capsules:
        p, _ = halves(x)
        return Capsules(p[None], (p + self.motion.longest * u)[None], np.array([self._width]))

    def extent(self, x: Array, u: Array) -> float:
        return self.motion.longest * hypot(*u.tolist()) + self._width

    def expected(self, x: Array) -> Capsules:
        p, _ = halves(x)
        motion = self.motion
        # Tracking takes φ' at most, and has less than it can: so 2 ρ, for a reference, is less.
        farthest = (motion.fastest + motion.disturbance) * motion.longest + motion.tube
        return balls(p, np.full(len(p), farthest))

    def rest_time(self, x: Array, u: Array) -> float:
        return self.motion.longest

    @cached_property
    def _width(self) -> float:
        """Width of T around the way [m]; φ', as tracking takes, is what φ and turning add [m/s]."""
        return self.motion.tracking.reserve * self.motion.longest + self.motion.tube


@dataclass(frozen=True)
class Brake:
    """Hold of a double integrator: it brakes first."""

    motion: PointMotion

    def tube(self, x: Array, u: Array) -> Capsules:
        motion, step = self.motion, self.motion.longest / _PIECES
        times = np.array([[(n + 0.5) * step] for n in range(_PIECES)])
        way = moved(x, u, motion.held(times))
        gain = self._gain(x, u)
        fastest = float(length(halves(x)[1])) + gain * motion.longest
        radius = self._moved(fastest, gain, 0.5 * step) + self._pushed(fastest) + motion.tube
        return self._segments(way, np.full(_PIECES, radius))

    def extent(self, x: Array, u: Array) -> float:
        return self.tube(x, u).reach(halves(x)[0])

    def expected(self, x: Array) -> Capsules:
        motion, tracking, speed = self.motion, self.motion.tracking, length(halves(x)[1])
        gain = sqrt(motion.axes) * motion.acceleration + motion.drag * speed
        fastest = speed + gain * motion.longest
        following = self._moved(speed, gain, motion.longest) + self._pushed(fastest)
        turn = (speed + tracking.speed_tube) / motion.authority + motion.longest
        holding = motion.tube + turn * tracking.speed_tube
        return self._segments(x, np.maximum(following, holding) + motion.tube)

    def rest_time(self, x: Array, u: Array) -> float:
        # It decelerates by at least ‖v‖ A / (‖v‖ + A τ), which gives the time from v to STILL.
        motion = self.motion
        speed = float(length(halves(x)[1])) + (self._gain(x, u) + motion.disturbance) * self._tau
        if speed <= STILL:
            return self._tau
        return self._tau + (speed - STILL) / motion.authority + self._tau * log(speed / STILL)

    @property
    def _tau(self) -> float:
        return self.motion.longest

    def _gain(self, x: Array, u: Array) -> float:
        """Bound on ‖v'‖ under u without φ, which decays with drag [m/s²]."""
        return float(length(u - self.motion.drag * halves(x)[1]))

    def _moved(self, speed: FloatT, gain: FloatT, time: float) -> FloatT:
        """Bound on how far both ends of the segment move within a time, from a speed [m]."""
        way = speed * time + 0.5 * gain * time * time
        return way + gain * (way / self.motion.authority + time * self._tau)

    def _pushed(self, fastest: FloatT) -> FloatT:
        """Bound on how far a disturbance moves both ends of the segment in one hold [m]."""
        off = self.motion.disturbance * self._tau
        turn = (fastest + off) / self.motion.authority + self._tau
        return off * (1.0 + 0.5 * self._tau + turn)

    def _segments(self, z: Array, radius: Array) -> Capsules:
        """The ways of references, shape (n, 2 axes), to where they stop."""
        p, v = halves(z)
        factor = length(v) / (2.0 * self.motion.authority) + self._tau
        return Capsules(p, p + factor[:, None] * v, radius)


def hold(motion: Motion) -> Fallback:
    """Return the fallback *hold* of a motion.

    Raises ValueError, in words with both numbers, if its disturbance is more than it can hold.
    """
    motion.tracking  # noqa: B018 - it raises
    return HoldPlace(motion) if isinstance(motion, VelocityMotion) else Brake(motion)


def started(motion: Motion, t: float, x: Array) -> Reference:
    """Return a fallback that begins at a sample."""
    return Reference(t, x, motion.brake(halves(x)[1]))


def continued(
    motion: Motion, held: Reference, t: float, velocity: Array | None = None
) -> Reference:
    """Return a fallback at a later sample, in a frame that moves with a velocity if one is given.

    Positions are those at rest, speeds and inputs those in the frame.
    """
    z = moved(held.z, held.u, motion.held(np.array([t - held.t])))
    if velocity is not None:
        z[: motion.axes] += (t - held.t) * velocity
    return started(motion, t, z)


def tracked(motion: Motion, reference: Reference, x: Array) -> Array:
    """Return the input that keeps x near the reference, shape (axes,)."""
    u: Array = reference.u + motion.tracking.pull(x - reference.z)
    return u
