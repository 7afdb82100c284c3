"""The scene model: what there is to draw of a scenario, and what can be told of a state."""

from functools import cached_property

import numpy as np

from phalanx.arrays import Array, Mask
from phalanx.curves.values import SafetyValues
from phalanx.scenario.model import Scenario
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.safety.limits import Boundary, Outlined
from phalanx.theory.safety.obstacles import Sphere, Wall
from phalanx_viewer.scene.colours import COLOURS, Colour, Role
from phalanx_viewer.scene.kinematics import Kinematics, lift

_MOST_SHOWN_WHOLE = 24
_PATH_POINTS = 96


class Surroundings:
    """A scenario's obstacles and formation in 3-D, in metres."""

    def __init__(self, scenario: Scenario, radius: float) -> None:
        """radius: of the disc drawn around every agent [m]."""
        self._scenario, formation = scenario, scenario.formation
        self.spheres: list[tuple[Array, float]] = [
            # Where the clearance is all disc, something is left to see.
            (lift(np.array(o.center)), max(o.clearance - radius, 0.3 * o.clearance))
            for o in scenario.obstacles
            if isinstance(o, Sphere)
        ]
        """Centers, shape (3,), and radii such that an agent's disc touches one where h = 0 [m]."""
        walls = [(o, lift(o.unit_normal)) for o in scenario.obstacles if isinstance(o, Wall)]
        self.walls = [(n * (o.offset - o.clearance + radius), n) for o, n in walls]
        """A point of each surface, shape (3,), that discs touch alike, and the normal into it."""
        limits = [field.boundary.limit for field in scenario.limits]
        lines = [line for l in limits if isinstance(l, Outlined) for line in l.outline()]
        self.outlines = [np.array([lift(np.array(point)) for point in line]) for line in lines]
        """Lines of the limits that can be drawn, such as a fence [m], shapes (s, 3)."""
        path: list[Array] = []
        if formation:
            times = np.linspace(0.0, formation.finish, _PATH_POINTS).tolist()
            path = [lift(formation.center(t).position) for t in times]
        self.path = np.array(path).reshape(-1, 3)
        """The formation centre's Bezier path [m], shape (s, 3); s = 0 without a formation."""
        self.corridor = 2.0 * formation.radius if formation else 0.0
        """Width of the formation on that path [m]; 0 without one."""

    def nearest(self, obstacle: int, p: Array) -> Array:
        """The point that stands for an obstacle seen from p [m]: a center, or a wall's foot.

        Beside a limit, p itself.
        """
        found = self._scenario.static[obstacle]
        if isinstance(found, Boundary):
            return p
        if isinstance(found, Sphere):
            return lift(np.array(found.center))
        normal = lift(found.unit_normal)
        return np.asarray(p + (found.offset - normal @ p) * normal)


class SceneModel:
    """A scenario as the viewer needs it; agents and pairs go by their indices in the swarm."""

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self.swarm, self.scenario, self.names = swarm, swarm.scenario, swarm.names
        self.crowded = len(self.names) > _MOST_SHOWN_WHOLE
        """Whether there are too many agents to show every one's name and links."""
        self.adversary: Mask = np.array([m.adversary for m in swarm.members])
        """Which agents are adversaries from the start, shape (N,)."""
        self.flat = bool(swarm.safe_set.positions[0].numel() == 2)
        """Whether the swarm lives in the plane."""
        function = self.scenario.safety.safe_set_function
        self.radius = float(getattr(function, "radius", 0.0)) / 2.0
        """Radius of a disc around every agent such that two touch where h = 0 [m]."""
        self.body = 0.8 * self.radius if self.radius else 0.3
        """Size to draw an agent at [m]."""
        self.surroundings = Surroundings(self.scenario, self.radius)
        self.kinematics = Kinematics(swarm.safe_set)
        self.values = SafetyValues(rows)

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
