"""The true continuous dynamics, integrated between events, and the true h along the way."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.plant.disturbance import SwarmDisturbance
from phalanx.plant.motion import Motion
from phalanx.plant.near import NearPairs
from phalanx.plant.psi import LargestPsi
from phalanx.plant.steps import STEPS_AT_ONCE, next_stretch
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.mapped import Index
from phalanx.theory.safety.composition import stacked_slices

Array = NDArray[np.float64]


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, left the finite numbers."""


class IntegrationSteps(NamedTuple):
    """What s integration steps showed."""

    times: Array
    """[s], shape (s,)"""
    pairs: Index
    """Which pairs count, shape (r,): no other is above them or above zero."""
    h: Array
    """Of each, shape (s, r)."""
    h_tot: Array
    """Of all pairs, shape (s,)."""
    psi: Array
    """The largest of their ψ_1 ... ψ_{q-1}, shape (s,); empty if q = 1."""


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
        self._near = NearPairs(swarm, self.motion)
        self._psi = LargestPsi(rows)
        self._seen: list[IntegrationSteps | DisturbanceKnot] = [
            DisturbanceKnot(0.0, self._line.value)
        ]
        self._see(np.zeros(1), self.x[None])

    def take_seen(self) -> list[IntegrationSteps | DisturbanceKnot]:
        """What integration showed since this was last called, in order."""
        seen, self._seen = self._seen, []
        return seen

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
                self._seen.append(DisturbanceKnot(self.t, self._line.value))
            count, dt, stop = next_stretch(self.t, until, self._line.end, self._longest)
            phi = self._line.at(self.t)
            x = self.motion.steps(count, self.x, self._u, phi, self._line.slope, dt)
            self.x = x[-1]
            self._see(self.t + dt * np.arange(1.0, count + 1), x)
            self.t = stop

    def _see(self, times: Array, x: Array) -> None:
        """Keep what states x, shape (s, n̄), are worth. Raises DivergedError."""
        finite = bool(np.isfinite(x).all())
        if finite:
            pairs, h, h_tot = self._near(x)
            finite = bool(np.isfinite(h_tot).all())
        if not finite:
            raise DivergedError(
                f"the state or h_tot is no longer finite at t = {times[-1]:.3f} s: check dynamics "
                "and laws for divisions by zero and unbounded growth"
            )
        psi = self._psi(x, self._near.chosen)
        self._seen.append(IntegrationSteps(times, pairs, h, h_tot, psi))
