"""Who and what there is to draw, and how a stacked state becomes places, headings and arrows."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.composition import stacked_slices
from phalanx.theory.safety.obstacles import Sphere, Wall

Array = NDArray[np.float64]

_HEADINGS = ("theta", "psi", "yaw", "heading")
_CURVE_POINTS = 96


@dataclass(frozen=True)
class Places:
    """The swarm at one state, everything in 3-D."""

    positions: Array
    """Output points [m], shape (N, 3)."""
    headings: Array
    """Unit vectors, or zero where an agent has none, shape (N, 3)."""


@dataclass(frozen=True)
class SceneModel:
    """A scenario as the viewer needs it."""

    swarm: Swarm

    @property
    def scenario(self) -> Scenario:
        """The resolved scenario."""
        return self.swarm.scenario

    @property
    def names(self) -> tuple[str, ...]:
        """Every agent's name."""
        return self.swarm.names

    @cached_property
    def adversary(self) -> NDArray[np.bool_]:
        """Which agents are adversaries from the start, shape (N,)."""
        return np.array([m.adversary for m in self.swarm.members])

    @cached_property
    def flat(self) -> bool:
        """Whether the swarm lives in the plane."""
        return bool(self.swarm.chain.set.positions[0].numel() == 2)

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
    def obstacles(self) -> list[tuple[Array, float]]:
        """Centers, shape (3,), and radii such that an agent's disc touches one where h = 0 [m]."""
        return [
            (lift(np.array(o.center)), max(o.clearance - self.radius, 0.3 * o.clearance))
            for o in self.scenario.obstacles
            if isinstance(o, Sphere)
        ]

    @cached_property
    def walls(self) -> list[tuple[Array, Array]]:
        """A point of the surface, shape (3,), and the unit normal into it, alike."""
        walls = [o for o in self.scenario.obstacles if isinstance(o, Wall)]
        surfaces = [wall.offset - wall.clearance + self.radius for wall in walls]
        normals = [lift(wall.unit_normal) for wall in walls]
        return [(n * at, n) for n, at in zip(normals, surfaces, strict=True)]

    @cached_property
    def path(self) -> Array:
        """The formation centre's Bezier path [m], shape (s, 3); s = 0 without a formation."""
        formation = self.scenario.formation
        if formation is None:
            return np.zeros((0, 3))
        times = np.linspace(0.0, formation.finish, _CURVE_POINTS)
        return np.array([lift(formation.center(float(t)).position) for t in times])

    def goals(self, t: float) -> Array:
        """Centre of the formation and the goals of its agents at t [m], shape (1 + g, 3)."""
        formation = self.scenario.formation
        if formation is None:
            return np.zeros((0, 3))
        slots = [slot for group in self.scenario.agents for slot in group.slots]
        goals = [formation.center(t), *(formation.goal(slot, t) for slot in slots)]
        return np.array([lift(goal.position) for goal in goals])

    @cached_property
    def inputs(self) -> tuple[slice, ...]:
        """Where each agent's input lies in the stack of all."""
        return stacked_slices([len(m.dynamics.inputs) for m in self.swarm.members])

    @cached_property
    def bounds(self) -> list[tuple[Array, Array] | None]:
        """Each agent's least and largest inputs, shapes (m_i,); None where they vary."""
        found: list[tuple[Array, Array] | None] = []
        for m, part in zip(self.swarm.members, self.swarm.chain.set.parts, strict=True):
            known = constant_polytope(*m.dynamics.input_polytope(self.swarm.chain.set.x[part]))
            corners = None if known is None else known.corners
            found.append(None if corners is None else (corners.min(axis=0), corners.max(axis=0)))
        return found

    def ends(self, pair: int) -> tuple[int, int | None]:
        """A pair's agents; None stands for an obstacle."""
        found = self.swarm.chain.set.pairs[pair]
        return found.a, found.b

    def other_end(self, pair: int, positions: Array) -> Array:
        """Where a pair's second partner is [m], shape (3,)."""
        found = self.swarm.chain.set.pairs[pair]
        if found.b is not None:
            return np.asarray(positions[found.b])
        assert found.obstacle is not None
        obstacle, p = self.scenario.obstacles[found.obstacle], positions[found.a]
        if isinstance(obstacle, Sphere):
            return lift(np.array(obstacle.center))
        normal = lift(obstacle.unit_normal)
        return np.asarray(p + (obstacle.offset - normal @ p) * normal)

    def label(self, pair: int) -> str:
        """A pair in words."""
        composed = self.swarm.chain.set
        return composed.label(composed.pairs[pair])

    def smallest_distance(self, positions: Array) -> float:
        """The smallest distance of a normal agent from any other [m]; infinite if it is alone."""
        distances, _ = cKDTree(positions).query(positions[~self.adversary], k=2)
        return float(np.asarray(distances)[:, 1].min())

    def places(self, x: Array) -> Places:
        """Everything drawn that depends on the state alone; x has shape (n̄,)."""
        positions, headings = self._places(x)
        return Places(positions.reshape(-1, 3), unit(headings.reshape(-1, 3)))

    def higher_psi(self, x: Array) -> Array:
        """ψ_1^d ... ψ_{q-1}^d, shape (q - 1,)."""
        return self._higher_psi(x)[0] if len(self.swarm.chain.psi) > 1 else np.zeros(0)

    def largest(self, x: Array) -> int:
        """The pair whose h is largest."""
        return int(np.argmax(self._h(x)[0]))

    def h(self, pair: int, x: Array) -> float:
        """One pair's h."""
        if pair not in self._h_of:
            composed = self.swarm.chain.set
            self._h_of[pair] = CompiledFunction([composed.x], [composed.h[pair]])
        return float(self._h_of[pair](x)[0][0])

    def arrows(self, x: Array, u: Array) -> Array:
        """What inputs, shape (Σ m_i,), do: the lowest derivative of p they act on, (N, 3)."""
        found: Array = self._arrows(x, u)[0].reshape(-1, 3)
        return found

    @cached_property
    def _h_of(self) -> dict[int, CompiledFunction]:
        return {}

    @cached_property
    def _h(self) -> CompiledFunction:
        return CompiledFunction([self.swarm.chain.set.x], [self.swarm.chain.set.h])

    @cached_property
    def _higher_psi(self) -> CompiledFunction:
        composed, chain = self.swarm.chain.set, self.swarm.chain
        higher = ca.vertcat(*[composed.substitute(psi) for psi in chain.psi[1:]])
        return CompiledFunction([composed.x], [higher])

    @cached_property
    def _places(self) -> CompiledFunction:
        composed = self.swarm.chain.set
        headings = [
            _heading(m.dynamics, composed.x[part])
            for m, part in zip(self.swarm.members, composed.parts, strict=True)
        ]
        positions = ca.vertcat(*[_lift(p) for p in composed.positions])
        return CompiledFunction([composed.x], [positions, ca.vertcat(*headings)])

    @cached_property
    def _arrows(self) -> CompiledFunction:
        composed = self.swarm.chain.set
        u = ca.SX.sym("u", self.inputs[-1].stop)
        rates = [
            _effect(m.dynamics, composed.x[part], u[held])
            for m, part, held in zip(self.swarm.members, composed.parts, self.inputs, strict=True)
        ]
        return CompiledFunction([composed.x, u], [ca.vertcat(*rates)])


def scene_model(scenario: Scenario) -> SceneModel:
    """Build the swarm to draw. Raises ScenarioError."""
    return SceneModel(build_swarm(scenario))


def lift(p: Array) -> Array:
    """A point of the plane or of space as one of space, shape (3,)."""
    return np.pad(p, (0, 3 - len(p)))


def unit(vectors: Array) -> Array:
    """Vectors, shape (..., 3), at length one; zero stays zero."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    units: Array = np.divide(vectors, lengths, out=np.zeros_like(vectors), where=lengths > 1e-9)
    return units


def _lift(p: ca.SX) -> ca.SX:
    return ca.vertcat(p, ca.SX.zeros(3 - p.numel()))


def _heading(dynamics: Dynamics, x: ca.SX) -> ca.SX:
    """Where an agent faces: along its heading angle, else along its velocity where x has it."""
    for k, name in enumerate(dynamics.states):
        if name in _HEADINGS:
            return ca.vertcat(ca.cos(x[k]), ca.sin(x[k]), 0)
    return _lift(ca.jacobian(dynamics.position(x), x) @ dynamics.drift(x))


def _effect(dynamics: Dynamics, x: ca.SX, u: ca.SX) -> ca.SX:
    """The lowest time derivative of the output point that depends on u, as a 3-vector."""
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    y = dynamics.position(x)
    for _ in range(x.numel()):
        y = ca.jacobian(y, x) @ rate
        if ca.depends_on(y, u):
            return _lift(y)
    return ca.SX.zeros(3)
