"""Crossing flows: agents start anywhere in a box, at a bounded density, and move along its axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge, Gt

from phalanx.arrays import Array
from phalanx.seeded.draws import Draws
from phalanx.theory.expressions.exact import length
from phalanx.theory.laws.formation import Goal
from phalanx.theory.safety.obstacles import Sphere

Positive = Annotated[float, Gt(0)]

_ATTEMPTS = 100


@dataclass(frozen=True)
class Flows:
    """As many flows as the box has faces, each along an axis and through all the others.

    The box is a square or a cube around the origin; its side grows with the number of agents, so
    that an agent's neighbours do not. A flow moves as a whole: its agents keep apart by themselves,
    and meet those of the others.
    """

    room: Positive
    """Of the box, for each agent: its area [m²] in the plane, its volume [m³] in space."""
    apart: Positive
    """Least distance between places where agents start, and between those and obstacles [m]."""
    speed: Positive
    """Of every flow [m/s]."""
    obstacles: Annotated[float, Ge(0)] = 0.0
    """Spheres or discs in the box, for each agent; a resolved scenario has them drawn."""
    clearance: Positive = 1.0
    """Of each [m]."""

    def side(self, agents: int, axes: int) -> float:
        """The box's side [m]."""
        # To the millimetre: the last digits of a root are the library's.
        return round(float((self.room * agents) ** (1.0 / axes)), 3)

    def draw(self, seed: int, agents: int, axes: int) -> tuple[list[Array], tuple[Sphere, ...]]:
        """Where each agent starts [m], and the obstacles.

        Args:
            seed: of the scenario.
            agents: how many.
            axes: 2 or 3.

        Raises:
            ValueError: there is no room for all of them.
        """
        wanted = agents + int(self.obstacles * agents)
        draws = Draws(seed, "flows", width=axes)
        side, places = self.side(agents, axes), np.empty((0, axes))
        for attempt in range(_ATTEMPTS * wanted):
            place = side * (draws[attempt] - 0.5)
            if (length(places - place) >= self.apart).all():
                places = np.vstack([places, place])
            if len(places) == wanted:
                return list(places[:agents]), _spheres(places[agents:], self.clearance)
        raise ValueError(
            f"no room for {wanted} agents and obstacles {self.apart:g} m apart; found "
            f"{len(places)}: raise flows.room or lower flows.apart"
        )

    def goal(self, i: int, start: Array, t: float) -> Goal:
        """Where agent i, which started at `start` [m], wants to be at t [s]."""
        axis, backwards = divmod(i % (2 * len(start)), 2)
        velocity = np.zeros(len(start))
        velocity[axis] = -self.speed if backwards else self.speed
        return Goal(start + t * velocity, velocity, np.zeros(len(start)))


def _spheres(centers: Sequence[Array] | Array, clearance: float) -> tuple[Sphere, ...]:
    return tuple(Sphere(tuple(center.tolist()), clearance) for center in centers)
