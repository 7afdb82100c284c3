"""Agents as their peers by radio know them: points (p, v) that inputs of their own move.

A double integrator is its own point. Where inputs act on the velocity of the output point y, the
point is (y, 0), and its input is that velocity at the sampled state, y' = M(x) u.
"""

import math
from functools import partial

import casadi as ca
import numpy as np
from msgspec.structs import replace

from phalanx.knowledge.motion import Motion, PointMotion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot, solve
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.polytope import Box, Polytope, constant_polytope, polytope
from phalanx.theory.models.wheeled import DifferentialDrive, Unicycle
from phalanx.theory.rows.row import Rows

MovedByVelocity = SingleIntegrator | Unicycle | DifferentialDrive


class AgentPoint:
    """A double integrator: its point's states and inputs are its own."""

    def __init__(self, motion: Motion, box: Box) -> None:
        """box: the agent's inputs."""
        self.motion, self._box = motion, box

    def of(self, x: Array) -> Array:
        """Return the point (p, v), shape (2 axes,), of a state, shape (n,)."""
        return x

    def at(self, x: Array, point: Array) -> Array:
        """Return the state x moved to where its point is another."""
        return point

    def input(self, x: Array, u: Array) -> Array:
        """Return the point's input, shape (axes,), of the agent's input at x, shape (m,)."""
        return u

    def of_both(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return the point, and its input, as `of` and `input` do."""
        return self.of(x), self.input(x, u)

    def applied(self, x: Array, u: Array) -> Array:
        """Return the agent's input of its point's input at x, without what rounding adds."""
        return self._box.nearest(u)

    def rows(self, x: Array, rows: Rows) -> Rows:
        """Return rows on the agent's input at x as rows on its point's."""
        return rows

    def turn(self, x: Array) -> Array | None:
        """Return how the set of the point's inputs is turned at x; None for not at all."""
        return None


class OutputPoint(AgentPoint):
    """An agent whose inputs act on the velocity of its output point, one for each axis."""

    def __init__(self, dynamics: Dynamics, motion: VelocityMotion, box: Box) -> None:
        super().__init__(motion, box)
        self._map = _input_map(dynamics)
        straight = self._map(np.zeros(len(dynamics.states)))[1]
        # M = R(θ) M(0): of each column of M(0) the turned one is known.
        self._unturned = straight if motion.turning > 0.0 else None

    def of(self, x: Array) -> Array:
        p = self._map(x)[0]
        return np.concatenate([p, np.zeros_like(p)])

    def at(self, x: Array, point: Array) -> Array:
        axes, moved = self.motion.axes, x.copy()
        moved[:axes] += point[:axes] - self.of(x)[:axes]
        return moved

    def input(self, x: Array, u: Array) -> Array:
        return dot(self._map(x)[1], u)

    def of_both(self, x: Array, u: Array) -> tuple[Array, Array]:
        p, to_velocity = self._map(x)
        return np.concatenate([p, np.zeros_like(p)]), dot(to_velocity, u)

    def applied(self, x: Array, u: Array) -> Array:
        return super().applied(x, _solved(self._map(x)[1], u[None])[0])

    def rows(self, x: Array, rows: Rows) -> Rows:
        return replace(rows, a=_solved(self._map(x)[1].T, rows.a))

    def turn(self, x: Array) -> Array | None:
        if self._unturned is None:
            return None
        return _solved(self._unturned.T, self._map(x)[1])


def agent_point(swarm: Swarm, i: int, defect: float = 0.0) -> AgentPoint:
    """Return agent i as others know it; defect: added to the bound of its disturbance.

    Raises ScenarioError for dynamics that are no points.
    """
    dynamics, group = swarm.members[i].dynamics, swarm.groups[i]
    if not isinstance(dynamics, DoubleIntegrator | MovedByVelocity):
        raise ScenarioError(
            f"{swarm.scenario.name}: agents of {swarm.names[i]}: expected a single- or "
            "double-integrator, a unicycle or a differential-drive where there is a radio or "
            f"safety.keep, got {group.dynamics['type']}"
        )
    key = "point", swarm.group_numbers[i], defect
    return swarm.functions.get(key, partial(built_point, swarm, i, defect))


def built_point(swarm: Swarm, i: int, defect: float) -> AgentPoint:
    """Build what agent_point keeps."""
    dynamics, group = swarm.members[i].dynamics, swarm.groups[i]
    radio, bound = group.radio, group.disturbance.bound + defect
    errors = (radio.position_error, radio.speed_error) if radio else (0.0, 0.0)
    inputs = constant_polytope(*dynamics.input_polytope(ca.SX.zeros(len(dynamics.states))))
    assert inputs is not None
    assert inputs.box is not None
    clock = swarm.horizon(i), group.clock.period - group.clock.jitter
    if isinstance(dynamics, DoubleIntegrator):
        size = dynamics.dimension, dynamics.acceleration, dynamics.drag
        return AgentPoint(PointMotion(*size, bound, *clock, *errors), inputs.box)
    assert isinstance(dynamics, MovedByVelocity)
    velocities = _velocities(dynamics, inputs, bound)
    return OutputPoint(dynamics, VelocityMotion(*velocities, *clock, errors[0]), inputs.box)


def _velocities(
    dynamics: MovedByVelocity, inputs: Polytope, bound: float
) -> tuple[Polytope, float, float]:
    """Return the output point's velocities at heading 0, the bound on its φ, and on its turning.

    bound: on the norm of the state's φ.
    """
    M = _input_map(dynamics)(np.zeros(len(dynamics.states)))[1]
    velocities = polytope(_solved(M.T, inputs.A), inputs.b)
    if isinstance(dynamics, SingleIntegrator):
        return velocities, bound, 0.0
    # y' = M u + φ_xy + b φ_θ n, and b θ' is what y' has sideways without φ.
    b = dynamics.offset
    turning = float(np.abs(velocities.corners[:, 1]).max()) / b + bound
    return velocities, math.sqrt(1.0 + b * b) * bound, turning


def _input_map(dynamics: Dynamics) -> CompiledFunction:
    """x -> y, shape (axes,), and M with y' = M u, shape (axes, axes)."""
    x = ca.SX.sym("x", len(dynamics.states))
    y = dynamics.position(x)
    return CompiledFunction([x], [y, ca.jacobian(y, x) @ dynamics.actuation(x)])


def _solved(A: Array, b: Array) -> Array:
    """Solutions of A x = b for each row of b, shape (k, m)."""
    return solve(np.repeat(A[None], len(b), axis=0), b)[0]
