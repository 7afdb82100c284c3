"""Integrate the true state of all agents from event to event, under inputs and disturbances."""

import math
from abc import ABC, abstractmethod

import casadi as ca
import numpy as np
from msgspec import Struct

from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.expressions.user_methods import located_method
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import Polytope, constant_polytope, polytope
from phalanx.theory.models.world import WorldNote
from phalanx.theory.safety.composition import stacked_slices
from phalanx_plant.world.disturbance import SwarmDisturbance
from phalanx_plant.world.motion import Motion

_MOST_STEPS = 4
"""Integration steps in one segment, at most."""


class Segment(Struct, frozen=True):
    """s integration steps of equal length, with constant inputs and linear disturbances."""

    t: float
    """Begin [s]."""
    dt: float
    """Length of each step [s]."""
    end: float
    """[s]"""
    phi: Array
    """Stacked disturbance at the begin, shape (n̄,)."""
    slope: Array
    """Time derivative of the disturbance, shape (n̄,)."""
    u: Array
    """Stacked inputs that the actuators hold."""
    start: Array
    """Stacked state at the begin, shape (n̄,)."""
    x: Array
    """Stacked state after each step, shape (s, n̄)."""
    p: Array
    """Output positions after each step [m], shape (s, N, d)."""


class DisturbanceKnot(Struct, frozen=True):
    """The disturbance φ at a knot; between two knots it is linear."""

    t: float
    """[s]"""
    phi: Array
    """Stacked, shape (n̄,)."""


Piece = Segment | DisturbanceKnot | WorldNote
History = list[Piece]
"""The motion between two events, in order."""


class Integration(ABC):
    """The state of all agents from x(0) on; every actuator holds zero before its first input."""

    start: History
    """At t = 0, with x(0) as a segment of no length."""

    def __init__(self, swarm: Swarm) -> None:
        self.t, self.x = 0.0, swarm.start()
        self.motion = swarm.functions.get(Motion, lambda: Motion(swarm.members, _MOST_STEPS))
        self.p = self.motion.positions(self.x)
        """Output positions [m], shape (N, d)."""
        self.inputs = stacked_slices([len(m.dynamics.inputs) for m in swarm.members])
        """Slice of each agent's inputs in the stack."""
        self._u = np.zeros(self.inputs[-1].stop)
        self._longest = swarm.time.integration_step

    def close(self) -> None:  # noqa: B027 - by default there is nothing to close
        """Leave nothing behind after the run."""

    def _segment_at_start(self, phi: Array, slope: Array) -> Segment:
        x = self.x
        return Segment(0.0, 0.0, 0.0, phi, slope, self._u, x, x[None], self.p[None])

    def hold(self, i: int, u: Array | float) -> None:
        """Make agent i's actuator hold u, shape (m_i,), from now on."""
        self._u = self._u.copy()  # segments keep the inputs until now
        self._u[self.inputs[i]] = u

    def held(self, i: int) -> Array:
        """Return the input that agent i's actuator holds, shape (m_i,)."""
        return self._u[self.inputs[i]].copy()

    @abstractmethod
    def integrate(self, until: float) -> History:
        """Integrate to `until` [s], in steps no longer than the scenario's integration step."""


class RungeKutta(Integration):
    """The motion of the declared dynamics, under the drawn disturbances."""

    def __init__(self, rows: SafetyRows) -> None:
        super().__init__(rows.swarm)
        self._disturbances = SwarmDisturbance(rows)
        line = self._line = self._disturbances.line(0.0, self.x)
        at_start = self._segment_at_start(line.value, line.slope)
        self.start = [DisturbanceKnot(0.0, line.value), at_start]

    def integrate(self, until: float) -> History:
        """Integrate to `until` [s], to each knot of a disturbance."""
        history: History = []
        while self.t < until:
            if self._line.end <= self.t:
                self._line = self._disturbances.line(self.t, self.x)
                history.append(DisturbanceKnot(self.t, self._line.value))
            begin, start, line = self.t, self.x, self._line
            stop = min(until, line.end)
            count = min(math.ceil((stop - begin) / self._longest), _MOST_STEPS)
            self.t = min(stop, begin + count * self._longest)
            dt = (self.t - begin) / count
            phi = line.at(begin)
            x, p = self.motion.steps(count, start, self._u, phi, line.slope, dt)
            self.x, self.p = x[-1], p[-1]
            history.append(Segment(begin, dt, self.t, phi, line.slope, self._u, start, x, p))
        return history


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, is no longer finite."""

    def __init__(self, quantity: str, t: float, check: str = "dynamics and laws") -> None:
        """Name the quantity that diverged.

        Args:
            quantity: a number, or several.
            t: when, at the latest [s].
            check: the code that may cause it.
        """
        super().__init__(
            f"{quantity} is no longer finite at t = {t:.3f} s: check {check} for divisions by zero "
            "and unbounded growth"
        )


class World:
    """The state of all agents and its history, Eq. (generalsystem)."""

    def __init__(self, rows: SafetyRows, integration: Integration | None = None) -> None:
        """Start at x(0), with every actuator at zero; integration: default of declared dynamics."""
        self.swarm = rows.swarm
        self.integration = integration or RungeKutta(rows)
        """Integrates this world; with lookahead it runs ahead, and the world follows."""
        self.t, self.x, self.p = 0.0, self.integration.x, self.integration.p
        self._history = self.integration.start

    def take_history(self) -> History:
        """Remove and return the history since the last call."""
        history, self._history = self._history, []
        return history

    def apply(self, i: int, u: Array) -> None:
        """Make agent i's actuator hold u, shape (m_i,), from now on."""
        self.integration.hold(i, u)

    def advance(self, until: float) -> None:
        """Integrate to `until` [s]. Raises DivergedError."""
        if until > self.t:
            self.follow(self.integration.integrate(until))

    def follow(self, pieces: History) -> None:
        """Append pieces that were integrated already. Raises DivergedError."""
        all_of = np.logical_and.reduce  # one call, where `all` makes three
        for piece in pieces:
            if type(piece) is Segment:
                small, finite = np.abs(piece.x) <= LARGEST, np.isfinite(piece.p)
                if not (all_of(small, axis=None) and all_of(finite, axis=None)):
                    raise self._diverged(piece)
                self.t, self.x, self.p = piece.end, piece.x[-1], piece.p[-1]
        self._history += pieces

    def _diverged(self, segment: Segment) -> DivergedError:
        """Name the agent whose state or output point is not finite, and the methods behind it."""
        members, end = self.swarm.members, segment.end
        finite = np.abs(segment.x) <= LARGEST
        for member, part in zip(members, self.swarm.safe_set.parts, strict=True):
            if not finite[:, part].all():
                methods = [
                    located_method(member.dynamics, method) for method in ("drift", "actuation")
                ]
                return DivergedError(
                    f"the state of agent {member.name}", end, " and ".join(methods)
                )
        member = members[int(np.argmin(np.isfinite(segment.p).all(axis=(0, 2))))]
        position = located_method(member.dynamics, "position")
        return DivergedError(f"the output point of agent {member.name}", end, position)


class Actuators:
    """The input polytopes U_i(x_i) of all agents."""

    def __init__(self, swarm: Swarm) -> None:
        different = {id(m.dynamics): m.dynamics for m in swarm.members}
        polytopes = {key: _input_polytope(dynamics) for key, dynamics in different.items()}
        self._polytopes = [polytopes[id(m.dynamics)] for m in swarm.members]
        widest = max(len(m.dynamics.inputs) for m in swarm.members)
        self._low, self._high = np.full((2, len(swarm.members), widest), [[[-np.inf]], [[np.inf]]])
        """Bounds of each agent's inputs, shape (N, m); none in a box that is not known."""
        for i, inputs in enumerate(self._polytopes):
            box = None if isinstance(inputs, CompiledFunction) else inputs.box
            if box is None:
                self._low[i] = np.inf
            else:
                self._low[i, : len(box.low)], self._high[i, : len(box.high)] = box.low, box.high

    def inside(self, i: Index, u: Array) -> Mask:
        """Return which inputs of agents i, (r,), are in a box that is known; u: padded, (r, m)."""
        inside: Mask = np.all((self._low[i] <= u) & (u <= self._high[i]), axis=1)
        return inside

    def takes(self, i: int, x: Array, u: Array) -> bool:
        """Return whether u, (m_i,), is within ACTUATION of U_i at agent i's state x, (n_i,)."""
        inputs = self._polytopes[i]
        if isinstance(inputs, CompiledFunction):
            A, b = inputs(x)
            inputs = polytope(A.reshape(len(b), -1), b)
        return inputs.takes(u)


def _input_polytope(dynamics: Dynamics) -> Polytope | CompiledFunction:
    """Return U, or the function x -> A, b if U depends on the state."""
    x = ca.SX.sym("x", len(dynamics.states))
    A, b = dynamics.input_polytope(x)
    return constant_polytope(A, b) or CompiledFunction([x], [A, b])
