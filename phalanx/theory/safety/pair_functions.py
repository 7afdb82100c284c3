"""Functions of single pairs, such as ψ_k, evaluated for many pairs of a swarm at once."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.mapped import MappedFunction
from phalanx.theory.safety.composition import ComposedSet
from phalanx.theory.safety.pairs import SwarmPairs, spread


class PairFunctions:
    """A function for each kind of pair, where more than h tells kinds apart: sorts of members."""

    def __init__(
        self,
        swarm: SwarmPairs,
        sorts: Sequence[int],
        make: Callable[[ComposedSet, tuple[int, int]], MappedFunction],
    ) -> None:
        """Sort pairs by more than their h.

        Args:
            swarm: whose pairs they are.
            sorts: of each member.
            make: the function of a pair alone, such as (a, b) is: of its states and parameters.
        """
        self._swarm, self._make = swarm, make
        self._sorts = np.concatenate([sorts, np.full(len(swarm.obstacles), -1)])
        self._made: dict[tuple[int, ...], MappedFunction] = {}

    def choose(self, pairs: Index) -> "ChosenFunctions":
        """Pairs that are evaluated together, shape (r, 2)."""
        swarm = self._swarm
        sorts = np.column_stack([self._sorts[pairs], swarm.kinds_of(pairs)])
        found, which = np.unique(sorts, axis=0, return_inverse=True)
        order = np.argsort(which.ravel(), kind="stable")
        groups = []
        for number, key in enumerate(map(tuple, found.tolist())):
            own = pairs[which.ravel() == number]
            a, b = own[0].tolist()
            alone = swarm.alone(a, b)
            if key not in self._made:
                self._made[key] = self._make(alone, (a, b))
            sizes = [part.stop - part.start for part in alone.parts]
            places = spread(swarm.begin, own, [*sizes, alone.parameters.numel()])
            groups.append((self._made[key], places))
        return ChosenFunctions(swarm, pairs[order], groups)


class ChosenFunctions(NamedTuple):
    """Functions of pairs, at any state of the swarm."""

    swarm: SwarmPairs
    pairs: Index
    """In the order of the results, shape (r, 2)."""
    groups: list[tuple[MappedFunction, Index]]

    def __call__(self, x: Array) -> Array:
        """At a stacked state, shape (n̄,) or (s, n̄); shape (r, outputs) or (s, r, outputs)."""
        numbers = self.swarm.numbers(x)
        return np.concatenate([f(numbers, places) for f, places in self.groups], axis=-2)
