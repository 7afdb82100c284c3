"""The true state of all agents, integrated from event to event; what actuators hold and can do."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.asked import place_of
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import LARGEST
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import Polytope, constant_polytope, polytope
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
        self._longest = swarm.time.integration_step
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


class DivergedError(ArithmeticError):
    """The true dynamics, or h along them, left the finite numbers."""

    def __init__(self, what: str, t: float, check: str = "dynamics and laws") -> None:
        """what: which number it was. t: when, at the latest [s]. check: whose it may be."""
        super().__init__(
            f"{what} is no longer finite at t = {t:.3f} s: check {check} for divisions by zero "
            "and unbounded growth"
        )


class World:
    """State of all agents and the inputs they hold, Eq. (generalsystem)."""

    def __init__(self, rows: SafetyRows) -> None:
        """Start at the scenario's x(0), with every actuator at zero."""
        self.swarm = rows.swarm
        self.integration = Integration(rows)
        """Of this world; whoever goes ahead with it lets the world follow."""
        self.t, self.x, self.p = 0.0, self.integration.x, self.integration.p
        self._way = self.integration.start()

    def take_way(self) -> list[Piece]:
        """What the world went through since this was last called, in order."""
        way, self._way = self._way, []
        return way

    def apply(self, i: int, u: Array) -> None:
        """Agent i's actuator holds u, shape (m_i,), from now on."""
        self.integration.hold(i, u)

    def advance(self, until: float) -> None:
        """Integrate to `until` [s]. Raises DivergedError."""
        self.follow(self.integration.to(until))

    def follow(self, way: Iterable[Piece]) -> None:
        """Go this way on from here. Raises DivergedError."""
        for piece in way:
            if isinstance(piece, Passage):
                if not ((np.abs(piece.x) <= LARGEST).all() and np.isfinite(piece.p).all()):
                    raise self._diverged(piece)
                self.t, self.x, self.p = piece.stretch.end, piece.x[-1], piece.p[-1]
            self._way.append(piece)

    def _diverged(self, passage: Passage) -> DivergedError:
        """Whose state or output point is no longer finite, and the methods that led there."""
        members, end = self.swarm.members, passage.stretch.end
        finite = np.abs(passage.x) <= LARGEST
        for member, part in zip(members, self.swarm.safe_set.parts, strict=True):
            if not finite[:, part].all():
                methods = [place_of(member.dynamics, method) for method in ("drift", "actuation")]
                return DivergedError(
                    f"the state of agent {member.name}", end, " and ".join(methods)
                )
        member = members[int(np.argmin(np.isfinite(passage.p).all(axis=(0, 2))))]
        position = place_of(member.dynamics, "position")
        return DivergedError(f"the output point of agent {member.name}", end, position)


class Actuators:
    """The input polytopes of all agents: what is outside U_i(x_i) cannot be applied."""

    def __init__(self, swarm: Swarm) -> None:
        different = {id(m.dynamics): m.dynamics for m in swarm.members}
        known = {key: _input_polytope(dynamics) for key, dynamics in different.items()}
        self._polytopes = [known[id(m.dynamics)] for m in swarm.members]

    def takes(self, i: int, x: Array, u: Array) -> bool:
        """Whether u, shape (m_i,), is within ACTUATION of U_i at agent i's state x, (n_i,)."""
        known = self._polytopes[i]
        if isinstance(known, CompiledFunction):
            A, b = known(x)
            known = polytope(A.reshape(len(b), -1), b)
        return known.takes(u)


def _input_polytope(dynamics: Dynamics) -> Polytope | CompiledFunction:
    """U, or the function x -> A, b where it depends on the state."""
    x = ca.SX.sym("x", len(dynamics.states))
    A, b = dynamics.input_polytope(x)
    return constant_polytope(A, b) or CompiledFunction([x], [A, b])
