"""A law for robots that meet: to the goal at a bounded speed, keeping right of others.

Without it those that meet head-on stand before one another: a filter alone breaks no symmetry.
"""

from dataclasses import dataclass
from typing import Annotated

import casadi as ca
import numpy as np
from annotated_types import Ge

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import length
from phalanx.theory.laws.law import View
from phalanx.theory.laws.tracking import Gains, tracked_chain
from phalanx.theory.models.dynamics import Dynamics, Positive


@dataclass
class GiveWay:
    """The output velocity w, tracked with k_2 where inputs act on its derivative::

        w = v^d + k_1 (p^d - p), at most `speed`, + push Σ_l (1 - d_l / within)₊ (right_l - to_l)

    to_l points to agent l at the distance d_l, right_l to the right of it, seen from above.

    >>> law = GiveWay(gains=(1.0, 2.0), speed=3.0)
    >>> law.prepare(DoubleIntegrator(acceleration=4.0, dimension=2))
    """

    gains: Gains
    """k_1, and k_2 if q = 2 [1/s]."""
    speed: Positive
    """[m/s]"""
    within: Positive = 4.0
    """Distance up to which others count [m]."""
    push: Annotated[float, Ge(0)] = 2.0
    """Change of w by another at distance 0 [m/s]."""

    def prepare(self, dynamics: Dynamics) -> None:
        chain = tracked_chain(dynamics, self.gains)
        if chain.degree > 2:
            raise ValueError(f"{type(dynamics).__name__}: expected q <= 2, got {chain.degree}")
        w = ca.SX.sym("w", chain.derivatives[0].numel())
        command = self.gains[1] * (w - chain.derivatives[1]) if chain.degree == 2 else w
        self._input = CompiledFunction([chain.x, w], [chain.input_for(command)])

    def input(self, view: View) -> Array:
        p, goal = view.positions[view.i], view.goal
        velocity = goal.velocity + self.gains[0] * (goal.position - p)
        velocity = velocity * min(1.0, self.speed / max(float(length(velocity)), self.speed))
        for l, other in view.positions.items():
            distance = float(length(other - p))
            if l != view.i and 0.0 < distance < self.within:
                to = (other - p) / distance
                right = np.concatenate(([to[1], -to[0]], np.zeros(len(to) - 2)))
                velocity = velocity + self.push * (1.0 - distance / self.within) * (right - to)
        return self._input(view.x[view.i], velocity)[0]
