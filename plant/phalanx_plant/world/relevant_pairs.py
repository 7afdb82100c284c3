"""The relevant pairs: those whose h can be above zero or can change h_tot.

For the safe-set functions that come with Phalanx the distance is known beyond which h is below a
given level. Pairs whose h is below zero, and too far below the largest one to change h_tot, are
left out. A spatial index finds the others; its answer is kept until an agent has moved too far.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.exact import dot
from phalanx.theory.safety.function import Reaching, proven_reach, static_reach
from phalanx.theory.safety.pairs import PairFunctions
from phalanx_plant.world.composition import negligible_below

_SLACK = 0.25
"""Share by which the search goes farther than it must, so that its result lasts for a while."""
_FEW = 40
"""So many pairs take as long to evaluate as to look up (18 of `unicycles`: 6 % more), and need no
tree, whose import alone takes .3 s."""
_FEW_ROWS = 500
"""The same where each pair has a row of its own, so that all its ψ are evaluated wherever its
agents are; in time it makes no difference (`guaranteed`, `swarm2d`: within 10 %)."""


class PairValues(NamedTuple):
    """The relevant pairs at s states."""

    pairs: Index
    """Indices of the pairs, shape (r,)."""
    values: Array
    """Values of the functions, h first, shape (s, r, q)."""
    least: Array
    """Pairs with a smaller h are irrelevant, whether left out or not, shape (s,)."""


class RelevantPairs:
    """Evaluates functions of the relevant pairs."""

    def __init__(self, swarm: Swarm, functions: PairFunctions) -> None:
        """Begin with every pair; `functions` are h of a pair, and others to evaluate with it."""
        scenario, function = swarm.scenario, swarm.safety.safe_set_function
        self._functions = functions
        self._obstacles = scenario.static
        self._normal = np.array([not m.adversary for m in swarm.members])
        self._every = swarm.pairs.every
        few = len(self._every) <= (_FEW_ROWS if swarm.safety.pairwise else _FEW)
        self._function = None if few else proven_reach(function)
        if self._function is not None:
            _spatial_index()  # now, and not in the middle of the run
        self._negligible = negligible_below(swarm.safety.rho, len(self._every))
        self.excluded: Mask = np.zeros(len(self._every), dtype=bool)
        """Pairs that make no other one irrelevant, shape (p,)."""
        members = len(swarm.members)
        self._numbers = np.full((members, members + len(scenario.static)), -1)
        self._numbers[tuple(self._every.T)] = np.arange(len(self._every))
        """The number of a pair of members at (a, b), of a and obstacle k at (a, N + k)."""
        self._choose(self._every)

    def __call__(self, x: Array, positions: Array) -> PairValues:
        """Evaluate at stacked states x, (s, n̄), with output positions [m], (s, N, d)."""
        values = self._chosen(x)
        if self._function is not None and not self._complete(positions, values[..., 0]):
            self._search(self._function, positions[0], values[..., 0])
            values = self._chosen(x)
            if not self._complete(positions, values[..., 0]):
                self._choose(self._every)
                values = self._chosen(x)
        return PairValues(self._which, values, self._least(values[..., 0]))

    def _choose(self, pairs: Index) -> None:
        self._chosen = self._functions.choose(pairs)
        a, b = self._chosen.pairs.T
        self._which = self._numbers[a, b]
        self._from: Array | None = None

    def _least(self, h: Array) -> Array:
        """Return PairValues.least for the h of some pairs."""
        if self._function is None:
            return np.full(len(h), -np.inf)
        # If pairs are missing, the largest h found is too small, which is safe.
        counted = np.where(self.excluded[self._which], -np.inf, h)
        least: Array = np.minimum(0.0, counted.max(axis=1) - self._negligible)
        return least

    def _complete(self, positions: Array, h: Array) -> bool:
        """Return whether the chosen pairs include all that are relevant at these states."""
        if self._from is None or not self._level <= self._least(h).min():
            return False
        moved = positions - self._from
        return bool(dot(moved, moved).max() <= self._room * self._room)

    def _search(self, function: Reaching, positions: Array, h: Array) -> None:
        """Choose the pairs that are relevant near these positions, (N, d), given h of some."""
        self._level = float(self._least(h).min()) - _SLACK * self._negligible
        reach = function.reach(self._level)
        self._room = _SLACK * reach / 2.0
        if not math.isfinite(reach):
            self._choose(self._every)
            return
        tree = _spatial_index()(positions)
        pairs = tree.query_pairs(reach + 2.0 * self._room, output_type="ndarray")
        # A normal member comes first; two adversaries are no pair of the safe set.
        pairs = np.where(self._normal[pairs[:, :1]], pairs, pairs[:, ::-1])
        blocks = [pairs[self._normal[pairs[:, 0]]]]
        for k, obstacle in enumerate(self._obstacles):
            close = static_reach(function, self._level, obstacle) + self._room
            near = np.flatnonzero(self._normal & (obstacle.distances(positions) <= close))
            blocks.append(np.stack([near, np.full(len(near), len(positions) + k)], axis=1))
        every = np.concatenate(blocks)
        # In the order of all pairs: sums then have the same bits, whichever pairs are left out.
        self._choose(self._every[np.sort(self._numbers[tuple(every.T)])])
        self._from = positions


def _spatial_index() -> Callable[[Array], Any]:
    """Import cKDTree, which takes most of a second: small swarms do without it."""
    from scipy.spatial import cKDTree

    found: Callable[[Array], Any] = cKDTree
    return found
