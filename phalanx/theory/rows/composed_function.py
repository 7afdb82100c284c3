"""h_tot of the pairs in sight at one state after another: one call of a function by kinds."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.bound import BoundFunction, rounded_up
from phalanx.theory.expressions.mapped import MappedFunction
from phalanx.theory.models.polytope import Polytope, extremes, polytope
from phalanx.theory.rows.by_kind import Shape, TermsByKind
from phalanx.theory.safety.pairs import ChosenPairs


class ComposedNumbers(NamedTuple):
    """What pairs are composed to, as Terms has it."""

    psi: Array
    unforced: float
    c: dict[int, Array]
    least: dict[int, float]
    most: dict[int, float]
    polytopes: dict[int, Polytope]
    pairs: ChosenPairs
    weights: Array
    """Of these pairs, as LogSumExpJets has them, shape (r, q)."""


class ComposedFunction:
    """Of the same pairs and members, whose numbers it finds by tables of places."""

    def __init__(self, by_kind: TermsByKind, seen: Sequence[int], pairs: ChosenPairs) -> None:
        """seen: members. pairs: of them, and of them with what stands still."""
        q, members = by_kind.pairs.degree, by_kind.members
        self._pairs, self._members, self._degree = pairs, members, q
        kinds = list(members.by_kind(seen).items())
        sizes = [(members.kinds[k].inputs, own) for k, own in kinds]
        self._c, end = _layout(sizes, q + 1)
        sizes = [(members.kinds[k].extremes.results, own) for k, own in kinds]
        self._ends, self._weights = _layout(sizes, end)
        self._varying = [l for l in self._ends if l not in members.known]
        self._least = [(l, own.start) for l, own in self._ends.items() if l in members.known]
        """Where the least of those with a constant U are; the most come next."""

        parts, tables = _Parts(by_kind, pairs), list[Index]()
        jets = _Jets(by_kind, pairs)
        owners = np.full(members.inputs[-1].stop, -1)
        for l, part in self._c.items():
            owners[members.inputs[l]] = np.r_[part] - (q + 1)
        pushes = _lists(owners[pairs.force_input], end - (q + 1))
        weights = np.append(pairs.force_pair * q + q - 1, 0)
        tables += parts.tables
        for group in pairs.groups:
            places = np.concatenate([group.places, *parts.of(group.number, group.pairs)], axis=1)
            tables.append(_filled(places, rounded_up(len(places))))
        tables += [jets.h, jets.forces[pushes], weights[pushes]]
        for k, own in kinds:
            tables.append(_filled(members.arguments(k, own), rounded_up(len(own))))
        shape = Shape(
            parts.shape,
            tuple((group.number, rounded_up(len(group.pairs))) for group in pairs.groups),
            tuple((k, rounded_up(len(own))) for k, own in kinds),
            len(jets.h),
            len(pushes),
        )
        arguments = [table.ravel().astype(np.float64) for table in tables]
        self._bound = BoundFunction(by_kind.function(shape), [by_kind.numbers.copy(), *arguments])
        self._x, self._found = self._bound.inputs[0][: by_kind.pairs.states], self._bound.outputs[0]

    def __call__(self, x: Array) -> ComposedNumbers:
        """At the stacked state, shape (n̄,)."""
        self._x[:] = x
        self._bound.call()
        found, q = self._found.copy(), self._degree
        numbers = found[: self._weights].tolist()
        composed = ComposedNumbers(
            found[:q],
            numbers[q],
            {l: found[own] for l, own in self._c.items()},
            {l: numbers[k] for l, k in self._least},
            {l: numbers[k + 1] for l, k in self._least},
            self._members.known,
            self._pairs,
            found[self._weights :].reshape(-1, q)[: len(self._pairs.pairs)],
        )
        return self._solved(composed, found) if self._varying else composed

    def psi(self, x: Array) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,), without any linear program."""
        self._x[:] = x
        self._bound.call()
        return self._found[: self._degree].copy()

    def _solved(self, composed: ComposedNumbers, found: Array) -> ComposedNumbers:
        """With the linear programs of members whose U_l is what it is at this state only."""
        polytopes = dict(composed.polytopes)
        for l in self._varying:
            row, c = found[self._ends[l]], composed.c[l]
            A, b = np.split(row, [len(row) * len(c) // (len(c) + 1)])
            polytopes[l] = polytope(A.reshape(len(b), -1), b)
            composed.least[l], composed.most[l] = extremes(c, polytopes[l].corners)
        return composed._replace(polytopes=polytopes)


class _Jets:
    """Where jets are among the results of all groups, which have room for more pairs."""

    def __init__(self, by_kind: TermsByKind, pairs: ChosenPairs) -> None:
        q, begin = by_kind.pairs.degree, 0
        h, forces = list[Index](), list[Index]()
        for group in pairs.groups:
            width = group.kind.shared.jets.results
            own = begin + np.arange(len(group.pairs) * width).reshape(-1, width)
            h.append(own[:, : q + 1])
            forces.append(own[:, q + 1 :].ravel())
            begin += rounded_up(len(group.pairs)) * width
        # After them FAR and zero: a pair that is none, and no force.
        nobody, count = np.array([[begin] + [begin + 1] * q]), len(pairs.pairs)
        self.h = np.concatenate([*h, nobody.repeat(rounded_up(count) - count, axis=0)])
        """h, L_f h, ..., L_f^q h, shape (room, q+1)."""
        self.forces = np.concatenate([*forces, [begin + 1]]).astype(np.intp)
        """In the order of ChosenPairs, shape (f+1,): the last is none."""


class _Parts:
    """What members have the same part of in all their pairs."""

    def __init__(self, by_kind: TermsByKind, pairs: ChosenPairs) -> None:
        self._of, begin = by_kind.parts_of, len(by_kind.numbers)
        self._first: dict[int, Index] = {}
        self.tables: list[Index] = []
        """Of the states that each function takes, row by row."""
        shape = []
        for number, part in enumerate(by_kind.parts):
            members = self._members(part, pairs)
            if not len(members):
                continue
            room = rounded_up(len(members))
            self.tables.append(_filled(by_kind.members.places(members.tolist()), room))
            shape.append((number, room))
            first = self._first[id(part)] = np.zeros(members[-1] + 1, dtype=np.intp)
            first[members] = begin + part.results * np.arange(len(members))
            begin += part.results * room
        self.shape = tuple(shape)

    def _members(self, part: MappedFunction, pairs: ChosenPairs) -> Index:
        """Of whom it is needed."""
        found = [
            group.pairs[:, side]
            for group in pairs.groups
            for side, own in enumerate(self._of[group.number])
            if own is part
        ]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *found]))

    def of(self, kind: int, pairs: Index) -> list[Index]:
        """Where the parts of both members of some pairs of a kind are, shapes (r, k)."""
        return [
            self._first[id(part)][pairs[:, side]][:, None] + np.arange(part.results)
            for side, part in enumerate(self._of[kind])
            if part
        ]


def _layout(kinds: Iterable[tuple[int, Sequence[int]]], begin: int) -> tuple[dict[int, slice], int]:
    """Where each member's numbers are from here on, and where they end; kinds: how many each."""
    found: dict[int, slice] = {}
    for size, own in kinds:
        found |= {l: slice(begin + n * size, begin + (n + 1) * size) for n, l in enumerate(own)}
        begin += size * rounded_up(len(own))
    return found, begin


def _filled(places: Index, room: int) -> Index:
    """With the first row again for all that there is room for."""
    return np.concatenate([places, places[:1].repeat(room - len(places), axis=0)])


def _lists(owners: Index, count: int) -> Index:
    """The numbers of what each owner has, in order, shape (most, count), then len(owners)."""
    order = np.argsort(owners, kind="stable")
    sizes = np.bincount(owners, minlength=count)
    table = np.full((rounded_up(int(sizes.max(initial=0))), count), len(owners))
    rank = np.arange(len(owners)) - (np.cumsum(sizes) - sizes)[owners[order]]
    table[rank, owners[order]] = order
    return table
