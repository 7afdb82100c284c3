"""The pairs whose h can count for anything, found by where agents are; the others are left out.

Of the safe-set functions that come with Phalanx it is known beyond which distance h is below any
level. Pairs whose h is below zero, and so far below the largest one that h_tot is the same number
without them, are then left out. Who is near whom is looked up in a spatial index, and stands until
somebody has moved too far.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.exact import dot
from phalanx.theory.safety.function import Reaching, proven_reach
from phalanx.theory.safety.limits import static_reach
from phalanx.theory.safety.pairs import PairFunctions
from phalanx_plant.world.composition import allowance

_SLACK = 0.25
"""How much farther than it must one looks, so that what is found stands for a while."""
_FEW = 40
"""So many pairs take as long to evaluate as to look up (18 of `unicycles`: 6 % more), and need no
tree, whose import alone takes .3 s."""
_FEW_ROWS = 500
"""So many have all their ψ looked at where each has a row of its own, wherever its agents are; in
time it makes no difference (`guaranteed`, `swarm2d`: within 10 %)."""


class Near(NamedTuple):
    """The pairs that count at s states."""

    pairs: Index
    """Which they are, by index, shape (r,)."""
    values: Array
    """What was asked of each, h first, shape (s, r, q)."""
    least: Array
    """Pairs whose h is less do not count, left out or not, shape (s,)."""


class NearPairs:
    """The numbers of the pairs that count."""

    def __init__(self, swarm: Swarm, functions: PairFunctions) -> None:
        """Begin with every pair.

        functions: h of a pair, and what else is asked of it.
        """
        scenario, function = swarm.scenario, swarm.safety.safe_set_function
        self._functions = functions
        self._obstacles = scenario.static
        self._normal = np.array([not m.adversary for m in swarm.members])
        self._every = swarm.pairs.every
        few = len(self._every) <= (_FEW_ROWS if swarm.safety.pairwise else _FEW)
        self._function = None if few else proven_reach(function)
        if self._function is not None:
            _spatial_index()  # now, and not in the middle of the run
        self._allowance = allowance(swarm.safety.rho, len(self._every))
        members = len(swarm.members)
        self._numbers = np.full((members, members + len(scenario.static)), -1)
        self._numbers[tuple(self._every.T)] = np.arange(len(self._every))
        """The number of a pair of members at (a, b), of a and obstacle k at (a, N + k)."""
        self._choose(self._every)

    def __call__(self, x: Array, positions: Array) -> Near:
        """At stacked states x, (s, n̄), where output positions are these [m], (s, N, d)."""
        found = self._chosen(x)
        if self._function is not None and not self._stands(positions, found[..., 0]):
            self._look(self._function, positions[0], found[..., 0])
            found = self._chosen(x)
            if not self._stands(positions, found[..., 0]):
                self._choose(self._every)
                found = self._chosen(x)
        return Near(self._which, found, self._least(found[..., 0]))

    def _choose(self, pairs: Index) -> None:
        self._chosen = self._functions.choose(pairs)
        a, b = self._chosen.pairs.T
        self._which = self._numbers[a, b]
        self._from: Array | None = None

    def _least(self, h: Array) -> Array:
        """As Near has it, of the h of some pairs."""
        if self._function is None:
            return np.full(len(h), -np.inf)
        # Of pairs that are too few the largest h is too small, which is safe.
        least: Array = np.minimum(0.0, h.max(axis=1) - self._allowance)
        return least

    def _stands(self, positions: Array, h: Array) -> bool:
        """Whether the pairs that were chosen are all that count at these states."""
        if self._from is None or not self._level <= self._least(h).min():
            return False
        moved = positions - self._from
        return bool(dot(moved, moved).max() <= self._room * self._room)

    def _look(self, function: Reaching, positions: Array, h: Array) -> None:
        """Choose the pairs that count near these positions, (N, d), given h of some."""
        self._level = float(self._least(h).min()) - _SLACK * self._allowance
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
