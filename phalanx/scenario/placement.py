"""Random placement: starts of agents in crossing flows, and obstacles on a path."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from annotated_types import Ge

from phalanx.network.draws import Draws
from phalanx.schema.fields import NonNegative, Positive
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.laws.formation import Formation
from phalanx.theory.laws.goals import Goal, Sight
from phalanx.theory.safety.obstacles import Sphere

_ATTEMPTS_FOR_EACH = 100
_ATTEMPTS = 10_000


@dataclass(frozen=True)
class Flows:
    """Flows along the axes, in both directions of each, that cross in a box.

    The box is a square or a cube around the origin; its side grows with the number of agents, so
    that the density of agents is constant. Agents of one flow move in parallel, and meet those of
    the others.
    """

    room: Positive
    """Area [m²] or volume [m³] of the box per agent."""
    apart: Positive
    """Least distance between starts, and from starts to obstacles [m]."""
    speed: Positive
    """Speed of every flow [m/s]."""
    obstacles: NonNegative = 0.0
    """Number of spheres or discs in the box per agent; a resolved scenario has them drawn."""
    clearance: Positive = 1.0
    """Clearance of each [m]."""

    def side(self, agents: int, axes: int) -> float:
        """Return the box's side [m]."""
        # To the millimetre: the last digits of a root depend on the library.
        return round(float((self.room * agents) ** (1.0 / axes)), 3)

    def draw(self, seed: int, agents: int, axes: int) -> tuple[list[Array], tuple[Sphere, ...]]:
        """Draw each agent's start [m], and the obstacles. Raises ValueError if there is no room."""
        wanted = agents + int(self.obstacles * agents)
        draws = Draws(seed, "flows", width=axes)
        side, places = self.side(agents, axes), np.empty((0, axes))
        for attempt in range(_ATTEMPTS_FOR_EACH * wanted):
            place = side * (draws[attempt] - 0.5)
            if (length(places - place) >= self.apart).all():
                places = np.vstack([places, place])
            if len(places) == wanted:
                return list(places[:agents]), _spheres(places[agents:], self.clearance)
        raise ValueError(
            f"no room for {wanted} agents and obstacles {self.apart:g} m apart; found "
            f"{len(places)}: raise flows.room or lower flows.apart"
        )

    def velocity(self, i: int, axes: int) -> Array:
        """Return the velocity of agent i's flow [m/s]."""
        axis, backwards = divmod(i % (2 * axes), 2)
        velocity = np.zeros(axes)
        velocity[axis] = -self.speed if backwards else self.speed
        return velocity


class Flow:
    """An agent's place in the flows as a reference."""

    def __init__(self, flows: Flows, i: int, start: Array) -> None:
        """Place agent i, which started at `start` [m]."""
        self.start, self.velocity = start, flows.velocity(i, len(start))
        self._rest = np.zeros(len(start))

    def goal(self, sight: Sight) -> Goal:
        return Goal(self.start + sight.t * self.velocity, self.velocity, self._rest)

    def end(self) -> Array | None:
        return None


def _spheres(centers: Sequence[Array] | Array, clearance: float) -> tuple[Sphere, ...]:
    return tuple(Sphere(tuple(center.tolist()), clearance) for center in centers)


@dataclass(frozen=True)
class Scatter:
    """Spheres around the second half of a path, as in Simulation 2."""

    count: Annotated[int, Ge(1)]
    clearance: Positive
    """Clearance of each [m]."""
    spread: tuple[NonNegative, ...]
    """Half-widths of the box around the path's point [m], one for each axis."""
    along: tuple[NonNegative, NonNegative] = (0.0, 1.0)
    """The part of the path, in s from 0 to 1."""
    apart: NonNegative = 0.0
    """Least distance between centers [m]."""
    clear: NonNegative = 0.0
    """Least distance of a center from every agent's start [m]."""

    def draw(self, seed: int, formation: Formation, starts: Sequence[Array]) -> tuple[Sphere, ...]:
        """Draw the obstacles around the formation's path, away from the agents' starts [m].

        Raises ValueError if the spread does not fit the path, or there is no room.
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
                return _spheres(centers, self.clearance)
        raise ValueError(f"no room for {self.count} obstacles that far apart; found {len(centers)}")


def _clear(center: Array, others: Sequence[Array], distance: float) -> bool:
    return all(float(length(center - other)) >= distance for other in others)
