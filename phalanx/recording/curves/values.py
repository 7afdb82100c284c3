"""Values of the safe set at a state: h of pairs, and the ψ_k of the chain."""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array, Index
from phalanx.theory.safety.pairs import ChosenPairs


@dataclass(frozen=True)
class SafetyValues:
    """h of pairs, by their indices in the composed set, and ψ_k as the scenario composes it."""

    rows: SafetyRows

    def h(self, pair: int, x: Array) -> float:
        """One pair's h at a state, shape (n̄,)."""
        return float(self._single(pair).h(x)[0])

    def unsafe(self, x: Array, turned: Collection[int] = ()) -> Index:
        """Pairs with h > 0, the largest h first; they have a normal agent that did not turn."""
        h = self.every_h(x, turned)
        # What is not a number is not safe either.
        indices = np.flatnonzero(~(h <= 0.0))
        largest_first: Index = indices[np.argsort(-h[indices], kind="stable")]
        return largest_first

    def every_h(self, x: Array, turned: Collection[int] = ()) -> Array:
        """h of the composed set's pairs at a state, shapes (n̄,) and (p,).

        It is -inf of a pair without a normal agent, as these agents turned adversary.
        """
        h = self._every.h(x)[self._indices]
        return np.where(self.rows.swarm.without_normal(turned), -np.inf, h) if turned else h

    def worst_pair(self, x: Array, turned: Collection[int] = ()) -> int:
        """The pair whose h is largest; it has a normal agent that did not turn adversary."""
        return int(self.every_h(x, turned).argmax())

    @property
    def psi_levels(self) -> range:
        """The k of ψ_1 ... ψ_{q-1}."""
        return range(1, self.rows.relative_degree)

    def higher_psi(self, x: Array) -> Array:
        """Largest ψ_k of all pairs, each alone or composed, for each of psi_levels."""
        if not self.psi_levels:
            return np.zeros(0)
        largest: Array = self._invariants(x).reshape(-1, self.rows.relative_degree).max(axis=0)
        return largest[1:]

    @cached_property
    def _invariants(self) -> Callable[[Array], Array]:
        return self.rows.invariants(of_all=True)

    @cached_property
    def _single(self) -> Callable[[int], ChosenPairs]:
        pairs = self.rows.swarm.pairs
        every = pairs.every
        # The worst pair is needed again and again.
        return lru_cache(maxsize=32)(lambda pair: pairs.choose(every[pair : pair + 1]))

    @cached_property
    def _every(self) -> ChosenPairs:
        pairs = self.rows.swarm.pairs
        return pairs.choose(pairs.every)

    @cached_property
    def _indices(self) -> Index:
        """Places of the composed set's pairs in the values of `_every`."""
        return np.argsort(self._every.order)
