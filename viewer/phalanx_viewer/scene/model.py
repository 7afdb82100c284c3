"""The scene model: what there is to draw of a scenario, and what can be told of a state."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Array
from phalanx.curves.values import SafetyValues
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.safety.limits import Boundary, Outlined
from phalanx.theory.safety.obstacles import Sphere, Wall
from phalanx_viewer.scene.colours import COLOURS, Colour, Role
from phalanx_viewer.scene.kinematics import Kinematics, lift

_MOST_SHOWN_WHOLE = 24
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


@dataclass(frozen=True)
class SceneModel:
    """A scenario as the viewer needs it; agents and pairs go by their indices in the swarm."""

    rows: SafetyRows

    @property
    def swarm(self) -> Swarm:
        """Who takes part, with what."""
        return self.rows.swarm

    @property
    def scenario(self) -> Scenario:
        """The resolved scenario."""
        return self.swarm.scenario

    @property
    def names(self) -> tuple[str, ...]:
        """Every agent's name."""
        return self.swarm.names

    @property
    def crowded(self) -> bool:
        """Whether there are too many agents to show every one's name and links."""
        return len(self.names) > _MOST_SHOWN_WHOLE

    @cached_property
    def adversary(self) -> NDArray[np.bool_]:
        """Which agents are adversaries from the start, shape (N,)."""
        return np.array([m.adversary for m in self.swarm.members])

    @cached_property
    def flat(self) -> bool:
        """Whether the swarm lives in the plane."""
        return bool(self.swarm.safe_set.positions[0].numel() == 2)

    @cached_property
    def radius(self) -> float:
        """Radius of a disc around every agent such that two touch where h = 0 [m]."""
        function = self.scenario.safety.safe_set_function()
        return float(getattr(function, "radius", 0.0)) / 2.0

    @cached_property
    def body(self) -> float:
        """Size to draw an agent at [m]."""
        return 0.8 * self.radius if self.radius else 0.3

    @cached_property
    def extent(self) -> tuple[Array, Array]:
        """Opposite corners of the box that holds what is known of a run beforehand [m]."""
        start = self.kinematics.poses(self.swarm.start()).positions
        centers = [center[None] for center, _ in self.surroundings.spheres]
        lines = self.surroundings.outlines
        known = np.concatenate([start, self.surroundings.path, *centers, *lines])
        reach = 4.0 * self.body
        return known.min(axis=0) - reach, known.max(axis=0) + reach

    @property
    def floor(self) -> float:
        """Height of the ground [m]: the plane itself, or below all that is known beforehand."""
        low, high = self.extent
        return 0.0 if self.flat else float(low[2] - 0.1 * (high - low).max())

    @cached_property
    def surroundings(self) -> Surroundings:
        """Obstacles and formation."""
        return Surroundings(self.scenario, self.radius)

    @cached_property
    def kinematics(self) -> Kinematics:
        """From state and inputs to poses and arrows."""
        return Kinematics(self.swarm.safe_set)

    @cached_property
    def values(self) -> SafetyValues:
        """h of pairs, and ψ_1 ... ψ_{q-1}."""
        return SafetyValues(self.rows)

    def first_colour(self, i: int) -> Colour:
        """Agent i's colour by its role at the start."""
        return COLOURS[Role.ADVERSARY if self.adversary[i] else Role.NORMAL]

    def ends(self, pair: int, positions: Array) -> tuple[Array, Array]:
        """Where a pair's two sides are [m], shapes (3,); positions has shape (N, 3)."""
        found = self.swarm.safe_set.pairs[pair]
        first = positions[found.a]
        if found.b is not None:
            return first, positions[found.b]
        assert found.obstacle is not None
        return first, self.surroundings.nearest(found.obstacle, first)

    def agents_of(self, pairs: list[int]) -> set[int]:
        """The agents that are in one of the pairs."""
        found = [self.swarm.safe_set.pairs[pair] for pair in pairs]
        return {side for pair in found for side in (pair.a, pair.b) if side is not None}

    def told(self, pair: int, x: Array, positions: Array) -> str:
        """How a pair stands at a state, shape (n̄,): h, and how far its sides are apart."""
        a, b = self.ends(pair, positions)
        found = f"h = {self.values.h(pair, x):.3g}"
        # A limit has no place of its own.
        return found if a is b else f"{np.linalg.norm(a - b):.2f} m, {found}"

    def label(self, pair: int) -> str:
        """A pair in words."""
        composed = self.swarm.safe_set
        return composed.label(composed.pairs[pair])


def scene_model(scenario: Scenario) -> SceneModel:
    """Build the swarm to draw, and its chain. Raises ScenarioError."""
    return SceneModel(build_rows(build_swarm(scenario)))
