"""What is around the agents: obstacles, and the formation that they are to keep."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from phalanx.arrays import Array
from phalanx.scenario.model import Scenario
from phalanx.theory.safety.limits import Boundary, Outlined
from phalanx.theory.safety.obstacles import Sphere, Wall
from phalanx_viewer.scene.geometry import lift

_PATH_POINTS = 96


@dataclass(frozen=True)
class Surroundings:
    """A scenario's obstacles and formation in 3-D, in metres."""

    scenario: Scenario
    radius: float
    """Radius of the disc drawn around every agent [m]."""

    @cached_property
    def spheres(self) -> list[tuple[Array, float]]:
        """Centers, shape (3,), and radii such that an agent's disc touches one where h = 0 [m]."""
        return [
            # Where the clearance is all disc, something is left to see.
            (lift(np.array(o.center)), max(o.clearance - self.radius, 0.3 * o.clearance))
            for o in self.scenario.obstacles
            if isinstance(o, Sphere)
        ]

    @cached_property
    def walls(self) -> list[tuple[Array, Array]]:
        """A point of each surface, shape (3,), that discs touch alike, and the normal into it."""
        walls = [o for o in self.scenario.obstacles if isinstance(o, Wall)]
        surfaces = [wall.offset - wall.clearance + self.radius for wall in walls]
        normals = [lift(wall.unit_normal) for wall in walls]
        return [(n * at, n) for n, at in zip(normals, surfaces, strict=True)]

    @cached_property
    def outlines(self) -> list[Array]:
        """Lines of the limits that can be drawn, such as a fence [m], shapes (s, 3)."""
        limits = [field.boundary.limit for field in self.scenario.limits]
        lines = [
            line for limit in limits if isinstance(limit, Outlined) for line in limit.outline()
        ]
        return [np.array([lift(np.array(point)) for point in line]) for line in lines]

    @cached_property
    def path(self) -> Array:
        """The formation centre's Bezier path [m], shape (s, 3); s = 0 without a formation."""
        formation = self.scenario.formation
        if formation is None:
            return np.zeros((0, 3))
        times = np.linspace(0.0, formation.finish, _PATH_POINTS)
        return np.array([lift(formation.center(float(t)).position) for t in times])

    @property
    def corridor(self) -> float:
        """Width of the formation on that path [m]; 0 without one."""
        formation = self.scenario.formation
        return 0.0 if formation is None else 2.0 * formation.radius

    def goals(self, t: float) -> Array:
        """Centre of the formation and the goals of its agents at t [m], shape (1 + g, 3)."""
        formation = self.scenario.formation
        if formation is None:
            return np.zeros((0, 3))
        slots = [slot for group in self.scenario.agents for slot in group.slots]
        goals = [formation.center(t), *(formation.goal(slot, t) for slot in slots)]
        return np.array([lift(goal.position) for goal in goals])

    def nearest(self, obstacle: int, p: Array) -> Array:
        """The point that stands for an obstacle seen from p [m]: a center, or a wall's foot.

        Beside a limit, p itself.
        """
        found = self.scenario.static[obstacle]
        if isinstance(found, Boundary):
            return p
        if isinstance(found, Sphere):
            return lift(np.array(found.center))
        normal = lift(found.unit_normal)
        return np.asarray(p + (found.offset - normal @ p) * normal)
