"""How far agents are apart, for links whose fates depend on it."""

import math

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction

Array = NDArray[np.float64]


class Distances:
    """Distances between output positions [m], from a stacked state."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts = swarm.safe_set.parts
        self._positions = []
        for member in swarm.members:
            x = ca.SX.sym("x", len(member.dynamics.states))
            self._positions.append(CompiledFunction([x], [member.dynamics.position(x)]))

    def between(self, x: Array, i: int, j: int) -> float:
        """From agent i to agent j in the stacked state x, shape (n̄,)."""
        own, other = (self._positions[a](x[self._parts[a]])[0] for a in (i, j))
        square = 0.0
        for p, q in zip(own.tolist(), other.tolist(), strict=True):
            # Not sum(): from Python 3.12 on it rounds otherwise.
            square += (p - q) * (p - q)
        return math.sqrt(square)
