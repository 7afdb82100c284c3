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
from phalanx_viewer.scene.colours import COLOURS, Colour, Role
from phalanx_viewer.scene.kinematics import Kinematics
from phalanx_viewer.scene.surroundings import Surroundings

_MOST_SHOWN_WHOLE = 24


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
