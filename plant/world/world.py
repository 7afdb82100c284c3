"""The true continuous dynamics, integrated between events."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.plant.world.disturbance import SwarmDisturbance
from phalanx.plant.world.motion import Motion
from phalanx.plant.world.steps import STEPS_AT_ONCE, next_stretch
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.safety.composition import stacked_slices

Array = NDArray[np.float64]


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, left the finite numbers."""

    def __init__(self, what: str, t: float) -> None:
        """what: which number it was. t: when, at the latest [s]."""
        super().__init__(
            f"{what} is no longer finite at t = {t:.3f} s: check dynamics and laws for divisions "
            "by zero and unbounded growth"
        )


class Passage(NamedTuple):
    """Where s integration steps led."""

    times: Array
    """[s], shape (s,)"""
    x: Array
    """Stacked states, shape (s, n̄)."""
    p: Array
    """Output positions [m], shape (s, N, d)."""


class DisturbanceKnot(NamedTuple):
    """φ where its slope changes; between knots it is a line."""

    t: float
    """[s]"""
    phi: Array
    """Stacked, shape (n̄,)."""


class World:
    """State of all agents and the inputs they hold, Eq. (generalsystem)."""

    def __init__(self, rows: SafetyRows) -> None:
        """Start at the scenario's x(0), with every actuator at zero."""
        swarm = rows.swarm
        self.t = 0.0
        self.x = swarm.start()
        self._inputs = stacked_slices([len(m.dynamics.inputs) for m in swarm.members])
        self._u = np.zeros(self._inputs[-1].stop)
        self._longest = swarm.scenario.time.integration_step
        self._disturbances = SwarmDisturbance(rows)
        self._line = self._disturbances.line(0.0, self.x)
        self.motion = Motion(swarm.members, STEPS_AT_ONCE)
        self.p = self.motion.positions(self.x)
        """Output positions of all agents [m], shape (N, d)."""
        self._way: list[Passage | DisturbanceKnot] = [
            DisturbanceKnot(0.0, self._line.value),
            Passage(np.zeros(1), self.x[None], self.p[None]),
        ]

    def take_way(self) -> list[Passage | DisturbanceKnot]:
        """What the world went through since this was last called, in order."""
        way, self._way = self._way, []
        return way

    def apply(self, i: int, u: Array) -> None:
        """Agent i's actuator holds u, shape (m_i,), from now on."""
        self._u[self._inputs[i]] = u

    def advance(self, until: float) -> None:
        """Integrate to `until` [s], in steps no longer than the scenario's integration step.

        Raises DivergedError.
        """
        while self.t < until:
            if self._line.end <= self.t:
                self._line = self._disturbances.line(self.t, self.x)
                self._way.append(DisturbanceKnot(self.t, self._line.value))
            count, dt, stop = next_stretch(self.t, until, self._line.end, self._longest)
            phi = self._line.at(self.t)
            x, p = self.motion.steps(count, self.x, self._u, phi, self._line.slope, dt)
            if not np.isfinite(x).all():
                raise DivergedError("the state", stop)
            self.x, self.p = x[-1], p[-1]
            self._way.append(Passage(self.t + dt * np.arange(1.0, count + 1), x, p))
            self.t = stop
