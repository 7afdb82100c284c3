"""Obstacles at random places around a formation's path, drawn by (seed, attempt)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from phalanx.arrays import Array
from phalanx.seeded.draws import Draws
from phalanx.theory.expressions.exact import length
from phalanx.theory.laws.formation import Formation
from phalanx.theory.safety.obstacles import Sphere

NonNegative = Annotated[float, Ge(0)]

_ATTEMPTS = 10_000


@dataclass(frozen=True)
class Scatter:
    """Spheres around the second half of a path, as in Simulation 2."""

    count: Annotated[int, Ge(1)]
    clearance: Annotated[float, Gt(0)]
    """Of each [m]."""
    spread: tuple[NonNegative, ...]
    """Half-widths of the box around the path's point [m], one for each axis."""
    along: tuple[NonNegative, NonNegative] = (0.0, 1.0)
    """The part of the path, in s from 0 to 1."""
    apart: NonNegative = 0.0
    """Least distance between centers [m]."""
    clear: NonNegative = 0.0
    """Least distance of a center from every agent's start [m]."""

    def draw(self, seed: int, formation: Formation, starts: Sequence[Array]) -> tuple[Sphere, ...]:
        """The obstacles.

        Args:
            seed: of the scenario.
            formation: whose path they lie around.
            starts: positions that they keep clear of [m].

        Raises:
            ValueError: the spread does not fit the path, or there is no room.
        """
        axes = len(formation.path[0])
        if len(self.spread) != axes:
            raise ValueError(f"spread: expected {axes} half-widths, got {len(self.spread)}")
        draws = Draws(seed, "scatter", width=axes + 1)
        centers: list[Array] = []
        for attempt in range(_ATTEMPTS):
            s, *place = draws[attempt]
            t = formation.finish * (self.along[0] + s * (self.along[1] - self.along[0]))
            box = np.array(self.spread) * (2.0 * np.array(place) - 1.0)
            center = formation.center(t).position + box
            if _clear(center, centers, self.apart) and _clear(center, starts, self.clear):
                centers.append(center)
            if len(centers) == self.count:
                return tuple(Sphere(tuple(c.tolist()), self.clearance) for c in centers)
        raise ValueError(f"no room for {self.count} obstacles that far apart; found {len(centers)}")


def _clear(center: Array, others: Sequence[Array], distance: float) -> bool:
    return all(float(length(center - other)) >= distance for other in others)
