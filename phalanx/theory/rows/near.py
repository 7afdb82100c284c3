"""Which obstacles an agent sees."""

from collections.abc import Sequence

import casadi as ca

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.static import Static


class ObstaclesInSight:
    """Compiled once for all agents that have dynamics and radius in common."""

    def __init__(self, obstacles: Sequence[Static]) -> None:
        self._obstacles = obstacles
        self._compiled: list[tuple[Dynamics, float, CompiledFunction]] = []

    def of(self, dynamics: Dynamics, radius: float | None) -> CompiledFunction | None:
        """x_i -> 1 for each obstacle within the radius [m], else 0; None if all of them count."""
        if radius is None or not self._obstacles:
            return None
        for known, its_radius, function in self._compiled:
            if its_radius == radius and known == dynamics:
                return function
        x = ca.SX.sym("x", len(dynamics.states))
        p = dynamics.position(x)
        near = [obstacle.distance(p) <= radius for obstacle in self._obstacles]
        function = CompiledFunction([x], [ca.vertcat(*near)])
        self._compiled.append((dynamics, radius, function))
        return function
