"""Which obstacles an agent sees."""

from collections.abc import Sequence

import casadi as ca

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.obstacles import Obstacle


def obstacles_within(
    radius: float | None, dynamics: Dynamics, obstacles: Sequence[Obstacle]
) -> CompiledFunction | None:
    """x_i -> 1 for each obstacle within the radius [m] of agent i, else 0; None if all count."""
    if radius is None or not obstacles:
        return None
    x = ca.SX.sym("x", len(dynamics.states))
    p = dynamics.position(x)
    near = [obstacle.distance(p) <= radius for obstacle in obstacles]
    return CompiledFunction([x], [ca.vertcat(*near)])
