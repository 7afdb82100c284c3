"""The pairs whose h can count for anything, found by where agents are; the others are left out.

A safe-set function may say beyond which distance its h is below any level. Pairs whose h is below
zero, and so far below the largest one that h_tot is the same number without them, are then left
out. Who is near whom is looked up in a spatial index, and stands until somebody has moved too far.
"""

import math
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.plant.world.motion import Motion
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.exact import dot
from phalanx.theory.expressions.mapped import Index, MappedFunction
from phalanx.theory.safety.composition import ComposedSet
from phalanx.theory.safety.function import Reaching
from phalanx.theory.safety.static import static_reach

Array = NDArray[np.float64]

_DIGITS = 60.0 * math.log(2.0)
"""All that is left out is at most 2^-60 of Σ exp(ρ (h - σ)): less than half its last digit."""
_SLACK = 0.25
"""How much farther than it must one looks, so that what is found stands for a while."""
_FEW = 500
"""So many pairs are faster evaluated than looked up."""


class NearPairs:
    """h of the pairs that count, and h_tot of all."""

    def __init__(self, swarm: Swarm, motion: Motion) -> None:
        """Begin with every pair."""
        scenario, function = swarm.scenario, swarm.scenario.safety.safe_set_function()
        rho = scenario.safety.rho
        self._pairs = swarm.pairs
        self._obstacles, self._motion = scenario.static, motion
        self._normal = np.array([not m.adversary for m in swarm.members])
        self._every = self._pairs.among(range(len(swarm.members)))
        few = len(self._every) <= _FEW
        self._function = function if isinstance(function, Reaching) and not few else None
        if self._function is not None:
            _spatial_index()  # now, and not in the middle of the run
        self._allowance = (_DIGITS + math.log(len(self._every))) / rho
        self._numbers = _numbers(swarm.safe_set)
        self._sum = _LogSumExp(rho)
        self._choose(self._every)

    def __call__(self, x: Array) -> tuple[Index, Array, Array]:
        """Of stacked states x, shape (s, n̄).

        Returns:
            which pairs count, by index, shape (r,); their h, (s, r); and h_tot of all, (s,).
        """
        h = self.chosen.h(x)
        if self._function is None:
            return self._which, h, self._sum(h)
        positions = self._motion.positions(x)
        if not self._stands(positions, h):
            self._look(self._function, positions[0], h)
            h = self.chosen.h(x)
            if not self._stands(positions, h):
                self._choose(self._every)
                h = self.chosen.h(x)
        return self._which, h, self._sum(h)

    def _choose(self, pairs: Index) -> None:
        self.chosen = self._pairs.choose(pairs)
        """The pairs that count at the last states."""
        a, b = self.chosen.pairs.T
        self._which = self._numbers[a, b]
        self._from: Array | None = None

    def _needed(self, h: Array) -> float:
        """h of whatever is left out must be below this."""
        # Of pairs that are too few the largest h is too small, which is safe.
        return min(0.0, float(h.max(axis=1).min()) - self._allowance)

    def _stands(self, positions: Array, h: Array) -> bool:
        """Whether the pairs that were chosen are all that count at these states."""
        if self._from is None or not self._level <= self._needed(h):
            return False
        moved = positions - self._from
        return bool(dot(moved, moved).max() <= self._room * self._room)

    def _look(self, function: Reaching, positions: Array, h: Array) -> None:
        """Choose the pairs that count near these positions, (N, d), given h of some."""
        self._level = self._needed(h) - _SLACK * self._allowance
        reach = function.reach(self._level)
        self._room = _SLACK * reach / 2.0
        if not math.isfinite(reach):
            self._choose(self._every)
            return
        tree = _spatial_index()(positions)
        pairs = tree.query_pairs(reach + 2.0 * self._room, output_type="ndarray")
        # A normal member comes first; adversaries' own collisions are nobody's.
        pairs = np.where(self._normal[pairs[:, :1]], pairs, pairs[:, ::-1])
        found = [pairs[self._normal[pairs[:, 0]]]]
        for k, obstacle in enumerate(self._obstacles):
            close = static_reach(function, self._level, obstacle) + self._room
            near = self._normal & (obstacle.distances(positions) <= close)
            beside = np.flatnonzero(near)
            found.append(np.stack([beside, np.full(len(beside), len(positions) + k)], axis=1))
        every = np.concatenate(found)
        self._choose(every[np.lexsort(every.T[::-1])])
        self._from = positions


def _spatial_index() -> Callable[[Array], Any]:
    """cKDTree, which takes most of a second to import: small swarms need not wait for it."""
    from scipy.spatial import cKDTree

    found: Callable[[Array], Any] = cKDTree
    return found


class _LogSumExp:
    """LSE of any number of h, of several states at once."""

    def __init__(self, rho: float) -> None:
        h, sigma, total = ca.SX.sym("h"), ca.SX.sym("sigma"), ca.SX.sym("total")
        self._exponential = MappedFunction([h, sigma], [ca.exp(rho * (h - sigma))])
        self._logarithm = MappedFunction([sigma, total], [sigma + ca.log(total) / rho])

    def __call__(self, h: Array) -> Array:
        """Of h, shape (s, r); shape (s,)."""
        sigma, pairs = h.max(axis=1), h.shape[1]
        beside = np.stack([np.arange(pairs), np.full(pairs, pairs)], axis=1)
        each = self._exponential(np.column_stack([h, sigma]), beside)[..., 0]
        total = np.add.reduce(each, axis=1)
        of_both = self._logarithm(np.column_stack([sigma, total]), np.array([[0, 1]]))
        return of_both[:, 0, 0]


def _numbers(composed: ComposedSet) -> Index:
    """The index of the pair of members a and b, or a and obstacle k, at (a, b) and (a, N + k)."""
    members = len(composed.members)
    table = np.full((members, members + len(composed.obstacles)), -1)
    for number, pair in enumerate(composed.pairs):
        table[pair.a, members + (pair.obstacle or 0) if pair.b is None else pair.b] = number
    return table
