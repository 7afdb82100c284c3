"""Values of the safe set at a state, for texts and plots."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.safety.pairs import ChosenPairs


@dataclass(frozen=True)
class SafetyValues:
    """h of pairs, and the chain of h_tot with all of them composed."""

    rows: SafetyRows

    def h(self, pair: int, x: Array) -> float:
        """One pair's h at a state, shape (n̄,)."""
        return float(self._alone(pair).h(x)[0])

    def unsafe(self, x: Array) -> Index:
        """The pairs with h > 0, the deepest first."""
        h = self._every.h(x)
        # What is not a number is not safe either.
        found = np.flatnonzero(~(h <= 0.0))
        deepest: Index = self._every.order[found[np.argsort(-h[found], kind="stable")]]
        return deepest

    def every_h(self, x: Array) -> Array:
        """h of the composed set's pairs at states (n̄,) or (s, n̄); shape (p,) or (s, p)."""
        found = self._every.h(x)
        return found[..., self._places]

    def worst_pair(self, x: Array) -> int:
        """The pair whose h is largest."""
        return int(self._every.order[self._every.h(x).argmax()])

    def higher_psi(self, x: Array) -> Array:
        """ψ_1^d ... ψ_{q-1}^d, shape (q - 1,)."""
        if self.rows.relative_degree == 1:
            return np.zeros(0)
        return self.rows.composed.jets(self._every.jets(x).h).psi[1:]

    @cached_property
    def _alone(self) -> Callable[[int], ChosenPairs]:
        """One pair; the worst one is asked for again and again."""
        choose, pairs = self.rows.swarm.pairs.choose, self._pairs
        return lru_cache(maxsize=32)(lambda pair: choose(pairs[pair : pair + 1]))

    @cached_property
    def _pairs(self) -> Index:
        swarm = self.rows.swarm
        return swarm.pairs.among(range(len(swarm.members)))

    @cached_property
    def _places(self) -> Index:
        """Where the values of `_every` have those of the composed set's pairs."""
        return np.argsort(self._every.order)

    @cached_property
    def _every(self) -> ChosenPairs:
        return self.rows.swarm.pairs.choose(self._pairs)
