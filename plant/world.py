"""The true continuous dynamics, integrated between events, and the true h along the way."""

import math
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.plant.disturbance import SwarmDisturbance
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.safety.composition import stacked_slices

Array = NDArray[np.float64]

_STEPS_AT_ONCE = 4


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, left the finite numbers."""


class IntegrationSteps(NamedTuple):
    """What s integration steps showed."""

    times: Array
    """[s], shape (s,)"""
    h: Array
    """Every pair's h, shape (s, p)."""
    h_tot: Array
    """shape (s,)"""
    psi: Array
    """The largest of all ψ_1 ... ψ_{q-1}, shape (s,); empty if q = 1."""


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
        self._disturbances = SwarmDisturbance(swarm, rows.chain)
        self._line = self._disturbances.line(0.0, self.x)
        truth = _truth(rows)
        self._steps = _runge_kutta(swarm, truth, _STEPS_AT_ONCE)
        x = swarm.safe_set.x
        h, h_tot, psi = CompiledFunction([x], truth.call([x]))(self.x)
        self._seen: list[IntegrationSteps | DisturbanceKnot] = [
            DisturbanceKnot(0.0, self._line.value),
            IntegrationSteps(np.zeros(1), h[None], h_tot, psi),
        ]

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
            stop = min(until, self._line.end)
            count = min(math.ceil((stop - self.t) / self._longest), _STEPS_AT_ONCE)
            stop = min(stop, self.t + count * self._longest)
            length = (stop - self.t) / count
            phi = self._line.at(self.t)
            steps = self._steps[count - 1]
            self.x, h, h_tot, psi = steps(self.x, self._u, phi, self._line.slope, length)
            if not (np.isfinite(self.x).all() and np.isfinite(h_tot).all()):
                raise DivergedError(
                    f"the state or h_tot is no longer finite at t = {stop:.3f} s: check dynamics "
                    "and laws for divisions by zero and unbounded growth"
                )
            times = self.t + length * np.arange(1.0, count + 1)
            self._seen.append(IntegrationSteps(times, h.reshape(count, -1), h_tot, psi))
            self.t = stop


def _truth(rows: SafetyRows) -> ca.Function:
    """x -> h of all pairs, a row; h_tot; and the largest of all ψ_1 ... ψ_{q-1}, or nothing.

    Neighbourhoods are left out: ψ is of all pairs, as one row for each or as their composition.
    """
    composed = rows.swarm.safe_set
    chains = rows.pair_chains.values() or [rows.chain]
    psi = [composed.substitute(psi) for chain in chains for psi in chain.psi[1:]]
    largest = ca.mmax(ca.vertcat(*psi)) if psi else ca.SX(0, 1)
    h_tot = composed.substitute(composed.h_tot)
    return ca.Function("truth", [composed.x], [composed.h.T, h_tot, largest])


def _runge_kutta(swarm: Swarm, truth: ca.Function, most: int) -> list[CompiledFunction]:
    """For 1 to `most` classical fourth-order steps: (x, u, φ, φ', dt) -> x⁺, and each step's truth.

    φ is the disturbance at the first step's begin; it goes on along its line.
    """
    composed = swarm.safe_set
    field = _vector_field(swarm)
    start, u = ca.SX.sym("x", composed.x.numel()), ca.SX.sym("u", field.numel_in(1))
    phi, slope = ca.SX.sym("phi", start.numel()), ca.SX.sym("slope", start.numel())
    dt = ca.SX.sym("dt")
    x = start
    h: list[ca.SX] = []
    h_tot: list[ca.SX] = []
    psi: list[ca.SX] = []
    functions = []
    for step in range(most):
        begin = phi + step * dt * slope
        middle, end = begin + dt / 2 * slope, begin + dt * slope
        k1 = field(x, u) + begin
        k2 = field(x + dt / 2 * k1, u) + middle
        k3 = field(x + dt / 2 * k2, u) + middle
        k4 = field(x + dt * k3, u) + end
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        pairs, total, largest = truth(x)
        h, h_tot, psi = [*h, pairs], [*h_tot, total], [*psi, largest]
        outputs = [x, ca.vertcat(*h), ca.vertcat(*h_tot), ca.vertcat(*psi)]
        functions.append(CompiledFunction([start, u, phi, slope, dt], outputs))
    return functions


def _vector_field(swarm: Swarm) -> ca.Function:
    """f(x) + g(x) u of all agents, stacked."""
    composed = swarm.safe_set
    dynamics = [m.dynamics for m in swarm.members]
    inputs = stacked_slices([len(d.inputs) for d in dynamics])
    u = ca.SX.sym("u", inputs[-1].stop)
    rates = [
        d.drift(composed.x[part]) + d.actuation(composed.x[part]) @ u[held]
        for d, part, held in zip(dynamics, composed.parts, inputs, strict=True)
    ]
    return ca.Function("f", [composed.x, u], [ca.vertcat(*rates)])
