"""The stacked state integrated from event to event, with the inputs that actuators hold."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.safety.composition import stacked_slices
from phalanx_plant.world.disturbance import SwarmDisturbance
from phalanx_plant.world.motion import Motion

_STEPS_AT_ONCE = 4


class Stretch(NamedTuple):
    """A few integration steps of one length, on one line of the disturbances."""

    steps: int
    dt: float
    """Of each step [s]."""
    end: float
    """[s]"""


class Passage(NamedTuple):
    """Where s integration steps led."""

    t: float
    """When the first begins [s]."""
    stretch: Stretch
    phi: Array
    """Stacked disturbance when the first begins, shape (n̄,)."""
    slope: Array
    """Of its line, shape (n̄,)."""
    u: Array
    """Stacked inputs that actuators hold."""
    start: Array
    """The stacked state when the first begins, shape (n̄,)."""
    x: Array
    """Stacked states, shape (s, n̄)."""
    p: Array
    """Output positions [m], shape (s, N, d)."""

    @property
    def times(self) -> Array:
        """When each step ends [s], shape (s,)."""
        found: Array = self.t + self.stretch.dt * np.arange(1.0, self.stretch.steps + 1)
        return found


class DisturbanceKnot(NamedTuple):
    """φ where its slope changes; between knots it is a line."""

    t: float
    """[s]"""
    phi: Array
    """Stacked, shape (n̄,)."""


Piece = Passage | DisturbanceKnot


class Integration:
    """The state of all agents from x(0) on, every actuator at zero before its first input."""

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self.t, self.x = 0.0, swarm.start()
        self.motion = Motion(swarm.members, _STEPS_AT_ONCE)
        self.p = self.motion.positions(self.x)
        """Output positions [m], shape (N, d)."""
        self.inputs = stacked_slices([len(m.dynamics.inputs) for m in swarm.members])
        """Where each agent's lie in the stack."""
        self._u = np.zeros(self.inputs[-1].stop)
        self._longest = swarm.scenario.time.integration_step
        self._disturbances = SwarmDisturbance(rows)
        self._line = self._disturbances.line(0.0, self.x)

    def start(self) -> list[Piece]:
        """What there is to be seen at x(0)."""
        phi, slope = self._line.value, self._line.slope
        no_way, x = Stretch(1, 0.0, 0.0), self.x
        here = Passage(0.0, no_way, phi, slope, self._u.copy(), x, x[None], self.p[None])
        return [DisturbanceKnot(0.0, phi), here]

    def hold(self, i: int, u: Array | float) -> None:
        """Agent i's actuator holds u, shape (m_i,), from now on."""
        self._u[self.inputs[i]] = u

    def held(self, i: int) -> Array:
        """What it holds, shape (m_i,)."""
        return self._u[self.inputs[i]].copy()

    def to(self, until: float) -> Iterator[Piece]:
        """Go to `until` [s], in steps no longer than the scenario's integration step."""
        while self.t < until:
            if self._line.end <= self.t:
                self._line = self._disturbances.line(self.t, self.x)
                yield DisturbanceKnot(self.t, self._line.value)
            begin, stretch = self.t, _next_stretch(self.t, until, self._line.end, self._longest)
            count, dt, self.t = stretch
            phi, slope = self._line.at(begin), self._line.slope
            start, u = self.x, self._u.copy()
            x, p = self.motion.steps(count, start, u, phi, slope, dt)
            self.x, self.p = x[-1], p[-1]
            yield Passage(begin, stretch, phi, slope, u, start, x, p)


def _next_stretch(t: float, until: float, knot: float, longest: float) -> Stretch:
    """From t [s] towards `until`, to the next knot of a disturbance at most.

    No step is longer than `longest` [s].
    """
    stop = min(until, knot)
    count = min(math.ceil((stop - t) / longest), _STEPS_AT_ONCE)
    stop = min(stop, t + count * longest)
    return Stretch(count, (stop - t) / count, stop)
