"""The scene model: a scenario's swarm, its poses and static geometry, ready to draw."""

from functools import cached_property
from itertools import chain, product
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.recording.curves.values import SafetyValues
from phalanx.scenario.model import Scenario
from phalanx.swarm.goals import AgentGoal
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.arrays import Array, Mask
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics, heading
from phalanx.theory.safety.composition import ComposedSet, stacked_slices
from phalanx.theory.safety.function import Boundary, outlines
from phalanx.theory.safety.obstacles import Sphere, Wall
from phalanx_viewer.scene.colours import COLOURS, Colour, Role

_MOST_SHOWN_WHOLE = 24
_PATH_POINTS = 96


class Poses(NamedTuple):
    """Positions and headings of all agents, in 3-D."""

    positions: Array
    """Output points [m], shape (N, 3)."""
    headings: Array
    """Unit vectors, or zero where an agent has none, shape (N, 3)."""


class Kinematics:
    """Maps from a swarm's state and inputs to poses and arrows."""

    def __init__(self, composed: ComposedSet) -> None:
        agents = list(zip(composed.members, composed.parts, strict=True))
        headings = [_heading(m.dynamics, composed.x[part]) for m, part in agents]
        positions = ca.vertcat(*[_in_space(p) for p in composed.positions])
        self._poses = CompiledFunction([composed.x], [positions, ca.vertcat(*headings)])
        self.inputs = stacked_slices([len(m.dynamics.inputs) for m in composed.members])
        """Each agent's slice of the stacked inputs."""
        u = ca.SX.sym("u", self.inputs[-1].stop)
        effects = [
            _effect(m.dynamics, composed.x[part], u[inputs])
            for (m, part), inputs in zip(agents, self.inputs, strict=True)
        ]
        self._effects = CompiledFunction([composed.x, u], [ca.vertcat(*effects)])

    def poses(self, x: Array) -> Poses:
        """The poses at a state, shape (n̄,)."""
        positions, headings = self._poses(x)
        return Poses(positions.reshape(-1, 3), unit(headings.reshape(-1, 3)))

    def effects(self, x: Array, u: Array) -> Array:
        """Effects of inputs, shape (Σ m_i,), on the lowest derivative of p they reach, (N, 3)."""
        effects: Array = self._effects(x, u)[0].reshape(-1, 3)
        return effects


def _in_space(p: ca.SX) -> ca.SX:
    return ca.vertcat(p, ca.SX.zeros(3 - p.numel()))


def _heading(dynamics: Dynamics, x: ca.SX) -> ca.SX:
    """An agent's heading: along its heading angle, else along its velocity if x has that."""
    if (turns := heading(dynamics)) is not None:
        return ca.vertcat(ca.cos(x[turns]), ca.sin(x[turns]), 0)
    return _in_space(ca.jacobian(dynamics.position(x), x) @ dynamics.drift(x))


def _effect(dynamics: Dynamics, x: ca.SX, u: ca.SX) -> ca.SX:
    """The lowest time derivative of the output point that depends on u, as a 3-vector."""
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    y = dynamics.position(x)
    for _ in range(x.numel()):
        y = ca.jacobian(y, x) @ rate
        if ca.depends_on(y, u):
            return _in_space(y)
    return ca.SX.zeros(3)


def in_space(p: Array) -> Array:
    """A point of the plane or of space as one of space, shape (3,)."""
    return np.pad(p, (0, 3 - len(p)))


def unit(vectors: Array) -> Array:
    """Vectors, shape (..., 3), at length one; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Array = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 1e-9)
    return units


def rotations_to(headings: Array) -> Array:
    """Quaternions, shape (N, 4), that rotate +x to unit headings, shape (N, 3).

    A zero heading gives no rotation.
    """
    x, y, z = headings.T
    # Half-way between no rotation and twice the rotation; for a heading of -x that is the zero
    # quaternion, and any half turn will do: about z.
    half = np.stack([1.0 + x, np.zeros_like(x), -z, y], axis=1)
    behind = x < -1.0 + 1e-9
    half[behind] = [0.0, 0.0, 0.0, 1.0]
    quaternions: Array = half / np.linalg.norm(half, axis=1, keepdims=True)
    return quaternions


class StaticGeometry:
    """Obstacles, limits and the formation's path of a scenario in 3-D, in metres."""

    def __init__(self, scenario: Scenario, radius: float) -> None:
        """radius: of the disc drawn around every agent [m]."""
        self._scenario, formation = scenario, scenario.formation
        self.spheres: list[tuple[Array, float]] = [
            # Something is left to see even where the clearance is no larger than the disc.
            (in_space(np.array(o.center)), max(o.clearance - radius, 0.3 * o.clearance))
            for o in scenario.obstacles
            if isinstance(o, Sphere)
        ]
        """Centers, shape (3,), and radii such that an agent's disc touches one where h = 0 [m]."""
        walls = [(o, in_space(o.unit_normal)) for o in scenario.obstacles if isinstance(o, Wall)]
        self.walls = [(n * (o.offset - o.clearance + radius), n) for o, n in walls]
        """A point of each surface, shape (3,), which discs touch where h = 0, and its normal."""
        lines = outlines(scenario.static)
        self.outlines = [np.array([in_space(np.array(point)) for point in line]) for line in lines]
        """Lines of limits such as a fence, and edges of boxes and polygons [m], shapes (s, 3)."""
        path: list[Array] = []
        if formation:
            times = np.linspace(0.0, formation.finish, _PATH_POINTS).tolist()
            path = [in_space(formation.center(t).position) for t in times]
        self.path = np.array(path).reshape(-1, 3)
        """The formation centre's Bezier path [m], shape (s, 3); s = 0 without a formation."""
        self.corridor = 2.0 * formation.radius if formation else 0.0
        """Width of the formation on that path [m]; 0 without one."""

    def nearest(self, obstacle: int, p: Array) -> Array:
        """The point of an obstacle that lines from p end at: its center, or a wall's foot [m].

        For a limit, which is everywhere, p itself.
        """
        boundary = self._scenario.static[obstacle]
        if isinstance(boundary, Boundary):
            return p
        if isinstance(boundary, Wall):
            normal = in_space(boundary.unit_normal)
            return np.asarray(p + (boundary.offset - normal @ p) * normal)
        return in_space(np.array(boundary.center))


class SceneModel:
    """A scenario as the viewer needs it; agents and pairs are their indices in the swarm."""

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self.swarm, self.scenario, self.names = swarm, swarm.scenario, swarm.names
        self.crowded = len(self.names) > _MOST_SHOWN_WHOLE
        """True if there are too many agents to show every one's name and links."""
        self.adversary: Mask = np.array([m.adversary for m in swarm.members])
        """Which agents are adversaries from the start, shape (N,)."""
        self.flat = bool(swarm.safe_set.positions[0].numel() == 2)
        """True if the swarm moves in the plane."""
        function = self.scenario.safety.safe_set_function
        self.radius = float(getattr(function, "radius", 0.0)) / 2.0
        """Radius of a disc around every agent such that two touch where h = 0 [m]."""
        self.body = 0.8 * self.radius if self.radius else 0.3
        """Size to draw an agent at [m]."""
        self.static = StaticGeometry(self.scenario, self.radius)
        self.kinematics = Kinematics(swarm.safe_set)
        self.values = SafetyValues(rows)

    @cached_property
    def extent(self) -> tuple[Array, Array]:
        """Opposite corners of a box around the start, obstacles and the formation's path [m]."""
        start = self.kinematics.poses(self.swarm.start()).positions
        centers = [center[None] for center, _ in self.static.spheres]
        points = np.concatenate([start, self.static.path, *centers, *self.static.outlines])
        reach = 4.0 * self.body
        return points.min(axis=0) - reach, points.max(axis=0) + reach

    @property
    def corners(self) -> Array:
        """Corners of that box [m], shape (8, 3)."""
        return np.array([*product(*zip(*self.extent, strict=True))])

    @property
    def floor(self) -> float:
        """Height of the ground [m]: the plane itself, or below `extent`."""
        low, high = self.extent
        return 0.0 if self.flat else float(low[2] - 0.1 * (high - low).max())

    def goals(self, t: float, x: Array) -> Array:
        """Each agent's goal at t [s] and a state, shape (n̄,); shape (N, 3), NaN for agents without.

        It is unknown too where it depends on what the agent saw before, or is a user's own.
        """
        states = {l: x[part] for l, part in enumerate(self.swarm.safe_set.parts)}
        goals = np.full((len(self.names), 3), np.nan)
        for i, goal in self._goals.items():
            goals[i] = in_space(goal(t, states).position)
        return goals

    @property
    def has_goals(self) -> bool:
        """True if goals() knows one."""
        return bool(self._goals)

    @cached_property
    def _goals(self) -> dict[int, AgentGoal]:
        swarm = self.swarm
        goals = {i: swarm.goal(i) for i in range(len(self.names)) if swarm.has_goal(i)}
        return {i: goal for i, goal in goals.items() if goal.of_now}

    def first_colour(self, i: int) -> Colour:
        """Agent i's colour by its role at the start."""
        return COLOURS[Role.ADVERSARY if self.adversary[i] else Role.NORMAL]

    def ends(self, pair: int, positions: Array) -> tuple[Array, Array]:
        """Positions of a pair's two sides [m], shapes (3,); positions has shape (N, 3)."""
        sides = self.swarm.safe_set.pairs[pair]
        first = positions[sides.a]
        if sides.b < len(positions):
            return first, positions[sides.b]
        return first, self.static.nearest(sides.b - len(positions), first)

    def agents_of(self, pairs: list[int]) -> set[int]:
        """The agents that are in one of the pairs."""
        sides = chain.from_iterable(self.swarm.safe_set.pairs[pair] for pair in pairs)
        return {side for side in sides if side < len(self.names)}

    def pair_text(self, pair: int, x: Array, positions: Array) -> str:
        """A pair's distance and h at a state, shape (n̄,), as text."""
        a, b = self.ends(pair, positions)
        h = f"h = {self.values.h(pair, x):.3g}"
        # A limit has no position of its own.
        return h if a is b else f"{np.linalg.norm(a - b):.2f} m, {h}"

    def label(self, pair: int) -> str:
        """A pair's name, such as "1-2"."""
        composed = self.swarm.safe_set
        return composed.label(composed.pairs[pair])


def scene_model(scenario: Scenario) -> SceneModel:
    """Build a scenario's swarm and its rows. Raises ScenarioError."""
    return SceneModel(build_rows(build_swarm(scenario)))
