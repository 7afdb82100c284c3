"""The pairs of a swarm as rows of numbers, evaluated kind by kind for those that count.

A pair is a row (a, b): a normal member a, and another member b or N + k for obstacle k. A function
of a kind takes few of the swarm's numbers, by their indices. For two unicycles and a sphere::

    numbers   x_0: x y θ | x_1: x y θ | sphere: center, clearance
    indices       0 1 2  |     3 4 5  |         6 7 8
    begin         0      |     3      |         6
    pair (0, 1)   0 1 2        3 4 5
    pair (0, 2)   0 1 2                         6 7 8
"""

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.cache import FunctionCache
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.safety.composition import ComposedSet, Member, of_pair
from phalanx.theory.safety.function import SafeSetFunction, Static
from phalanx.theory.safety.kinds import (
    PairKind,
    kind_table,
    member_classes,
    parameters_of,
    require_degree,
    with_any_sphere,
)
from phalanx.theory.safety.obstacles import Sphere


class SwarmPairs:
    """The pairs of a swarm: the kind of each, and the indices of its numbers."""

    def __init__(
        self,
        members: Sequence[Member],
        obstacles: Sequence[Static],
        function: SafeSetFunction,
        gains: int,
        functions: FunctionCache | None = None,
    ) -> None:
        """Find the kinds of all pairs.

        Args:
            gains: number of α_k, one for each degree up to q.
            functions: of swarms that differ in starts, sides and the numbers of spheres alone.

        Raises:
            RelativeDegreeError: q differs, or the members' inputs appear at different degrees.
        """
        self.functions = functions or FunctionCache()
        self.adversaries = tuple(m.adversary for m in members)
        """Whether each member is one: with the same ones, the kinds are the same."""
        self.degree = gains
        """q."""
        self.members, self.obstacles, self._function = members, obstacles, function
        self._normal = np.array([not m.adversary for m in members])
        key = "kinds of pairs", self.adversaries
        of_member, self.kinds, self._kind = self.functions.get(key, self._find_kinds)
        count = self._kind.shape[1]  # of classes and obstacles
        self._class = np.concatenate([of_member, np.arange(count - len(obstacles), count)])
        numbers = [parameters_of(obstacle) for obstacle in obstacles]
        states = [len(m.dynamics.states) for m in members]
        self.states = sum(states)
        """n̄; the obstacles' parameters come after the states."""
        self.parameters: Array = np.concatenate([np.zeros(0), *numbers])
        """The parameters of all obstacles, one after the other."""
        self.begin: Index = _begins([*states, *map(len, numbers)])
        """First index of each member's state and of each obstacle's parameters."""
        self.inputs: Index = _begins([len(m.dynamics.inputs) for m in members])
        """First index of each member's input in the stack of all."""

    def _find_kinds(self) -> tuple[Index, list[PairKind], Index]:
        """Each member's class; the kinds; and the table of kinds by class."""
        members, gains = self.members, self.degree
        classes, of_member = member_classes(members)
        kinds, table = kind_table(classes, of_member, self.obstacles, self._function, gains)
        require_degree(members, of_member, kinds, table, gains)
        return of_member, kinds, table

    def among(self, in_sight: Sequence[int], obstacles: Sequence[int] | None = None) -> Index:
        """The pairs of h_tot among these members and obstacles, shape (r, 2).

        They come in the order of ComposedSet.pairs.

        Args:
            in_sight: members, in ascending order.
            obstacles: None for all.
        """
        members, count = np.array(in_sight, dtype=np.intp), len(self._normal)
        normal = members[self._normal[members]]
        others = members[~self._normal[members]]
        around = range(len(self._class) - count) if obstacles is None else obstacles
        near = count + np.array(around, dtype=np.intp)
        first, second = np.triu_indices(len(normal), 1)
        friends = np.stack([normal[first], normal[second]], axis=1)
        mixed = [
            np.stack([np.repeat(normal, len(side)), np.tile(side, len(normal))], axis=1)
            for side in (others, near)
        ]
        return np.concatenate([friends, *mixed])

    @cached_property
    def every(self) -> Index:
        """All pairs of h_tot, shape (p, 2)."""
        return self.among(range(len(self.members)))

    def choose(self, pairs: Index) -> "ChosenPairs":
        """Choose pairs to evaluate together, shape (r, 2)."""
        kinds = self.kinds_of(pairs)
        order = np.argsort(kinds, kind="stable")
        return ChosenPairs(self, pairs[order], kinds[order], order)

    def of(self, i: int, in_sight: Sequence[int], obstacles: Sequence[int] | None = None) -> Index:
        """Normal member i's pairs among these members and obstacles, as `among` lists them."""
        pairs = self.among(in_sight, obstacles)
        of_member: Index = pairs[(pairs == i).any(axis=1)]
        return of_member

    def ordered(self, i: int, other: int) -> tuple[int, int]:
        """The pair of normal member i and another member or N + k; of two normal ones sorted."""
        friend = other < len(self.members) and not self.members[other].adversary
        return (other, i) if friend and other < i else (i, other)

    def kinds_of(self, pairs: Index) -> Index:
        """The index in `kinds` of each pair's kind, shape (r,)."""
        kinds: Index = self._kind[self._class[pairs[:, 0]], self._class[pairs[:, 1]]]
        return kinds

    def kind_of(self, a: int, b: int) -> PairKind:
        """The kind of one pair."""
        number = int(self._kind[self._class[a], self._class[b]])
        return self.kinds[number]

    def alone(self, a: int, b: int) -> ComposedSet:
        """A pair as a safe set of its own; a sphere's numbers are symbols where its kind allows."""
        member = self.members[a]
        if b < len(self.members):
            return of_pair(member, self.members[b], self._function)
        obstacle = self.obstacles[b - len(self.members)]
        if isinstance(obstacle, Sphere) and self.kind_of(a, b).pair.parameters.numel():
            return with_any_sphere(member, obstacle, self._function)
        return of_pair(member, obstacle, self._function)

    def numbers(self, x: Array) -> Array:
        """Stacked states x, shape (n̄,) or (s, n̄), followed by the obstacles' parameters."""
        if not len(self.parameters):
            return x
        if x.ndim == 1:
            return np.concatenate([x, self.parameters])
        around = np.broadcast_to(self.parameters, (*x.shape[:-1], len(self.parameters)))
        return np.concatenate([x, around], axis=-1)


class Jets(NamedTuple):
    """Derivatives of r pairs' h along the drift; for s states at once every shape begins with s."""

    h: Array
    """h, L_f h, ..., L_f^q h, shape (r, q+1)."""
    forces: Array
    """L_{g_l} L_f^{q-1} h, shape (f,): for each pair, member of it and input of that."""


class _Group(NamedTuple):
    """Pairs of one kind."""

    number: int
    """Index in SwarmPairs.kinds."""
    kind: PairKind
    pairs: Index
    """shape (r, 2)"""
    indices: Index
    """Indices of each pair's numbers, shape (r, k)."""


class ChosenPairs:
    """Pairs to evaluate at any state of the swarm; to be kept while they stay the same."""

    def __init__(self, swarm: SwarmPairs, pairs: Index, kinds: Index, order: Index) -> None:
        """pairs: sorted by kind. kinds: of each. order: their indices before they were sorted."""
        self.pairs = pairs
        """In the order of all results, shape (r, 2)."""
        self.order = order
        """Their indices among the arguments of SwarmPairs.choose, shape (r,)."""
        self._swarm, self.groups = swarm, list[_Group]()
        forces, slopes = [], []
        for number in np.unique(kinds).tolist():
            which = np.flatnonzero(kinds == number)
            kind, group = swarm.kinds[number], pairs[which]
            indices = spread(swarm.begin, group, kind.pair.sizes)
            inputs = [len(member.dynamics.inputs) for member in kind.pair.members]
            self.groups.append(_Group(number, kind, group, indices))
            forces.append((which, spread(swarm.inputs, group, inputs)))
            slopes.append((which, indices[:, : kind.pair.x.numel()]))
        self.force_pair, self.force_input = _flat(forces)
        """Each force's pair, and its input's index in the stack of all; shapes (f,)."""
        self.slope_pair, self.slope_state = _flat(slopes)
        """Each slope's pair, and its state's index in x; shapes (g,)."""

    def h(self, x: Array) -> Array:
        """h at a stacked state, shape (n̄,) or (s, n̄); shape (r,) or (s, r)."""
        results = self._evaluated(x, lambda kind: kind.h)
        return np.concatenate(
            [np.zeros((*x.shape[:-1], 0)), *[h[..., 0] for h in results]], axis=-1
        )

    def jets(self, x: Array) -> Jets:
        """h, its derivatives along the drift and the inputs' part in the last; x as for h."""
        above, lead = self._swarm.degree + 1, x.shape[:-1]
        results = self._evaluated(x, lambda kind: kind.jets)
        h = [np.zeros((*lead, 0, above)), *[jet[..., :above] for jet in results]]
        forces = [np.zeros((*lead, 0)), *[jet[..., above:].reshape(*lead, -1) for jet in results]]
        return Jets(np.concatenate(h, axis=-2), np.concatenate(forces, axis=-1))

    def slopes(self, x: Array) -> Array:
        """∂(L_f^k h)/∂x_l for k = 0 ... q-1, shape (q, g): by pair and state of its members."""
        q = self._swarm.degree
        results = self._evaluated(x, lambda kind: kind.gradients)
        blocks = [
            slopes.reshape(len(slopes), q, -1).swapaxes(0, 1).reshape(q, -1) for slopes in results
        ]
        return np.concatenate([np.zeros((q, 0)), *blocks], axis=1)

    def _evaluated(self, x: Array, function: Callable[[PairKind], MappedFunction]) -> list[Array]:
        numbers = self._swarm.numbers(x)
        return [function(group.kind)(numbers, group.indices) for group in self.groups]


def _begins(sizes: Sequence[int]) -> Index:
    return np.cumsum([0, *sizes])[:-1]


def spread(begin: Index, pairs: Index, sizes: Sequence[int]) -> Index:
    """Indices of all numbers of each pair, whose side s has sizes[s] numbers."""
    sides = [
        begin[side][:, None] + np.arange(size) for side, size in zip(pairs.T, sizes, strict=False)
    ]
    return np.concatenate(sides, axis=1)


def _flat(groups: Sequence[tuple[Index, Index]]) -> tuple[Index, Index]:
    """The pair of each number, and its index, over all groups."""
    pairs = [np.repeat(which, indices.shape[1]) for which, indices in groups]
    nothing = np.zeros(0, dtype=np.intp)
    return (
        np.concatenate([nothing, *pairs]),
        np.concatenate([nothing, *[indices.ravel() for _, indices in groups]]),
    )


class PairFunctions:
    """A function for each kind of pair and sorts of its members, where h alone is too coarse."""

    def __init__(
        self,
        swarm: SwarmPairs,
        sorts: Sequence[int],
        make: Callable[[ComposedSet, int], MappedFunction],
    ) -> None:
        """Prepare.

        Args:
            swarm: the pairs.
            sorts: a number for each member.
            make: (a pair alone, number of its kind) -> the function of its states and parameters.
        """
        self._swarm, self._make = swarm, make
        self._sorts = np.concatenate([sorts, np.full(len(swarm.obstacles), -1)])
        self._functions: dict[tuple[int, ...], MappedFunction] = {}

    def choose(self, pairs: Index) -> "ChosenFunctions":
        """Choose pairs to evaluate together, shape (r, 2)."""
        swarm = self._swarm
        sorts = np.column_stack([self._sorts[pairs], swarm.kinds_of(pairs)])
        keys, which = np.unique(sorts, axis=0, return_inverse=True)
        order = np.argsort(which.ravel(), kind="stable")
        groups = []
        for number, key in enumerate(map(tuple, keys.tolist())):
            group = pairs[which.ravel() == number]
            a, b = group[0].tolist()
            alone = swarm.alone(a, b)
            if key not in self._functions:
                self._functions[key] = self._make(alone, key[-1])
            groups.append((self._functions[key], spread(swarm.begin, group, alone.sizes)))
        return ChosenFunctions(swarm, pairs[order], groups)


class ChosenFunctions(NamedTuple):
    """Functions of chosen pairs, at any state of the swarm."""

    swarm: SwarmPairs
    pairs: Index
    """In the order of the results, shape (r, 2)."""
    groups: list[tuple[MappedFunction, Index]]

    def __call__(self, x: Array) -> Array:
        """Evaluate at x, shape (n̄,) or (s, n̄); shape (r, outputs) or (s, r, outputs)."""
        numbers = self.swarm.numbers(x)
        return np.concatenate([f(numbers, indices) for f, indices in self.groups], axis=-2)
