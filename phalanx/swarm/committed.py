"""Members as the rule of commitments sees them: points with a fallback, and what others can reach.

Where the fallback is to leave, with a velocity w that all normal agents share, a point's speed and
inputs are those in the frame that moves with w: it has less of its inputs, by what keeps w.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from phalanx.knowledge.held import halves
from phalanx.knowledge.motion import Motion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.promise.flight import Flights
from phalanx.promise.hold import Fallback, hold
from phalanx.promise.reach import Reach
from phalanx.swarm.points import AgentPoint, agent_point, built_point
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.dynamics import Bounded
from phalanx.theory.models.polytope import polytope
from phalanx.theory.models.wheeled import Unicycle

_BISECTIONS = 12


class CommittedPoint:
    """An agent's point in the frame of its fallback."""

    motion: Motion

    def __init__(self, point: AgentPoint, velocity: Array | None) -> None:
        """velocity: of the frame, shape (axes,) [m/s]; None for one at rest."""
        self._point, self._rest, self.motion = point, velocity is None, point.motion
        if velocity is None:
            return
        motion = point.motion
        if isinstance(motion, VelocityMotion):
            inputs = motion.velocities
            shifted = polytope(inputs.A, inputs.b - dot(inputs.A, velocity))
            self._input, self._speed = velocity, np.zeros_like(velocity)
            self.motion = replace(motion, velocities=shifted)
        else:
            self._input, self._speed = motion.drag * velocity, velocity
            least = motion.acceleration - float(np.abs(self._input).max())
            self.motion = replace(motion, acceleration=least)

    def of(self, x: Array) -> Array:
        """Return the point (p, v), shape (2 axes,), of a state, shape (n,); or of rows of them."""
        return self._in_frame(self._point.of(x))

    def of_both(self, x: Array, u: Array) -> tuple[Array, Array]:
        """Return the point, and its input, shape (axes,), of the agent's input, shape (m,)."""
        point, w = self._point.of_both(x, u)
        return self._in_frame(point), w if self._rest else w - self._input

    def _in_frame(self, point: Array) -> Array:
        if self._rest:
            return point
        p, v = halves(point)
        return np.concatenate([p, v - self._speed], axis=-1)

    def applied(self, x: Array, u: Array) -> Array:
        """Return the agent's input of its point's input at x."""
        return self._point.applied(x, u if self._rest else u + self._input)


def exit_velocity(swarm: Swarm) -> Array | None:
    """Return w of the fallback *exit*, shape (axes,); None for *hold*."""
    velocity = swarm.safety.exit_velocity
    return None if velocity is None else np.array(velocity)


def trusted(swarm: Swarm, i: int) -> tuple[int, ...]:
    """Return the other normal agents, which keep the rule; by `unknown` no role is read."""
    reads_roles = swarm.safety.information_model.reads_roles
    return tuple(l for l in swarm.normal if l != i) if reads_roles else ()


def committed_point(swarm: Swarm, i: int) -> CommittedPoint:
    """Return agent i as a point, with the defect of integration as a disturbance.

    Raises ScenarioError for dynamics that are no points.
    """
    point, velocity = agent_point(swarm, i, DEFECT), exit_velocity(swarm)
    key = "committed point", swarm.group_numbers[i], swarm.safety.exit_velocity
    return swarm.functions.get(key, partial(CommittedPoint, point, velocity))


def fallback_of(swarm: Swarm, i: int) -> Fallback:
    """Return agent i's fallback. Raises ValueError if φ is more than it can hold."""
    return hold(committed_point(swarm, i).motion)


def flights_of(swarm: Swarm, i: int) -> Flights:
    """Return agent i's ways out. Raises ValueError if φ is more than it can turn against."""
    model, group = swarm.members[i].dynamics, swarm.groups[i]
    assert isinstance(model, Unicycle)
    shortest = group.clock.period - group.clock.jitter
    return Flights(model, group.disturbance.bound + DEFECT, swarm.horizon(i), shortest)


def reach_of(swarm: Swarm, l: int) -> Reach:
    """Return the reach of a member."""
    dynamics = swarm.members[l].dynamics
    assert isinstance(dynamics, Bounded)
    return Reach(dynamics, swarm.groups[l].disturbance.bound + DEFECT)


def largest_bound(swarm: Swarm, i: int) -> float:
    """Return the largest bound on agent i's disturbance with which its fallback holds; 0: none."""
    bound = swarm.groups[i].disturbance.bound

    def holds(less: float) -> bool:
        point = built_point(swarm, i, less - bound + DEFECT)
        return holds_place(CommittedPoint(point, exit_velocity(swarm)).motion)

    return largest(bound, holds)


def holds_place(motion: Motion) -> bool:
    """Return whether an agent can hold a place against its disturbance."""
    try:
        motion.tracking  # noqa: B018 - it raises
    except ValueError:
        return False
    return True


def largest(most: float, holds: Callable[[float], bool]) -> float:
    """Return the largest number up to a bound for which something holds; 0 if for none."""
    low, high = 0.0, most
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
