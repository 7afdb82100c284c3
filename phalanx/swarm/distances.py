"""How far agents are apart, for links whose fates depend on it."""

import math

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm


class Distances:
    """Distances between output positions [m], from a stacked state."""

    def __init__(self, swarm: Swarm) -> None:
        self._parts, self._position = swarm.safe_set.parts, swarm.position

    def between(self, x: Array, i: int, j: int) -> float:
        """From agent i to agent j in the stacked state x, shape (n̄,)."""
        own, other = (self._position(a)(x[self._parts[a]])[0] for a in (i, j))
        square = 0.0
        for p, q in zip(own.tolist(), other.tolist(), strict=True):
            # Not sum(): from Python 3.12 on it rounds otherwise.
            square += (p - q) * (p - q)
        return math.sqrt(square)
