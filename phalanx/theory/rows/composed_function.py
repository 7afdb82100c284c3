"""h_tot of the pairs in sight at one state after another: one call of a compiled function.

The places of the pairs' and members' numbers are arguments. So the function grows with the number
of kinds only, and serves all agents that see as many of each kind.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import Self

import casadi as ca
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.compiled import BoundFunction
from phalanx.theory.models.polytope import Polytope, extremes, polytope
from phalanx.theory.rows.members import SwarmMembers
from phalanx.theory.safety.pairs import ChosenPairs, SwarmPairs

MembersByKind = Sequence[tuple[int, Sequence[int]]]
"""(number of a kind, members of it)."""
Placed = tuple[ca.Function, list[Index]]
"""A function of numbers and places, and these places."""


class ComposedNumbers(Struct, frozen=True):
    """Terms of composed pairs, as numbers; fields are those of Terms."""

    psi: Array
    unforced: float
    disturbance: float
    """D_q; 0 if the margin does not contain it."""
    c: dict[int, Array]
    least: dict[int, float]
    most: dict[int, float]
    polytopes: dict[int, Polytope]


class Gathered:
    """Numbers at given places; each list of places becomes an argument of the function."""

    def __init__(self) -> None:
        self.places: list[ca.MX] = []

    def __call__(self, values: ca.MX, height: int, width: int) -> ca.MX:
        """The numbers as a matrix, with a column for each row of places."""
        self.places.append(ca.MX.sym("places", height * width))
        return ca.reshape(values[self.places[-1]], height, width)


class TermsByKind(ABC):
    """Builder of functions that compute terms, one for each number of pairs and members."""

    def __init__(self, pairs: SwarmPairs, members: SwarmMembers) -> None:
        self.pairs, self.members = pairs, members
        self.numbers: Array = np.concatenate(
            [np.zeros(pairs.states), pairs.parameters, members.corners]
        )
        """A function's numbers: the state, obstacles' parameters and the corners of each U."""

    def with_pairs(self, pairs: SwarmPairs) -> Self:
        """The same functions for pairs by SwarmPairs.with_obstacles."""
        other, numbers = copy(self), self.numbers.copy()
        numbers[pairs.states : pairs.states + len(pairs.parameters)] = pairs.parameters
        other.pairs, other.numbers = pairs, numbers
        return other

    @abstractmethod
    def room(self, count: int) -> int:
        """Number of members that the function has room for, at least `count`."""

    @abstractmethod
    def function(self, members: MembersByKind, pairs: ChosenPairs) -> Placed:
        """The function of the numbers for these members and pairs.

        Its results: ψ_0 ... ψ_{q-1}, the unforced part and D_q; c of all members; and for each the
        least and most of c u, or A and b of a U that varies with the state.
        """

    def layout(self, sizes: MembersByKind, begin: int) -> tuple[dict[int, slice], int]:
        """The slice of each member's numbers, from `begin` on, and their end.

        sizes: (count of numbers, members with as many).
        """
        found: dict[int, slice] = {}
        for size, own in sizes:
            found |= {l: slice(begin + n * size, begin + (n + 1) * size) for n, l in enumerate(own)}
            begin += size * self.room(len(own))
        return found, begin

    def extremes(
        self, numbers: ca.MX, c: ca.MX, rooms: Sequence[tuple[int, int]], chosen: Gathered
    ) -> list[ca.MX]:
        """Least and most of c u, or A and b; rooms: (number of a kind, room for its members)."""
        found, begin = [], 0
        for k, room in rooms:
            kind = self.members.kinds[k]
            own = ca.reshape(c[begin : (begin := begin + kind.inputs * room)], kind.inputs, room)
            if kind.polytope is None:
                row = chosen(numbers, kind.x.numel(), room)
            else:
                row = ca.vertcat(own, chosen(numbers, len(kind.corners), room))
            found.append(ca.vec(kind.extremes.mapped(room)(row)))
        return found


class ComposedFunction:
    """Terms of fixed pairs and members, whose numbers it finds by tables of places."""

    def __init__(self, by_kind: TermsByKind, seen: Sequence[int], pairs: ChosenPairs) -> None:
        """seen: members. pairs: among them, and with obstacles and limits."""
        members, self._degree = by_kind.members, by_kind.pairs.degree
        kinds = list(members.by_kind(seen).items())
        sizes = [(members.kinds[k].inputs, own) for k, own in kinds]
        self._c, end = by_kind.layout(sizes, self._degree + 2)
        sizes = [(members.kinds[k].extremes.results, own) for k, own in kinds]
        self._ends, _ = by_kind.layout(sizes, end)
        self._known = members.known
        self._varying = [l for l in self._ends if l not in self._known]
        self._least = [(l, own.start) for l, own in self._ends.items() if l in self._known]
        """Place of the least of each member with a constant U; the most comes next."""
        function, tables = by_kind.function(kinds, pairs)
        arguments = [table.ravel().astype(np.float64) for table in tables]
        self._bound = BoundFunction(function, [by_kind.numbers.copy(), *arguments])
        self._x, self._found = self._bound.inputs[0][: by_kind.pairs.states], self._bound.outputs[0]

    def __call__(self, x: Array) -> ComposedNumbers:
        """Evaluate at the stacked state, shape (n̄,)."""
        self._x[:] = x
        self._bound.call()
        found, q = self._found.copy(), self._degree
        numbers = found.tolist()
        composed = ComposedNumbers(
            found[:q],
            numbers[q],
            numbers[q + 1],
            {l: found[own] for l, own in self._c.items()},
            {l: numbers[k] for l, k in self._least},
            {l: numbers[k + 1] for l, k in self._least},
            self._known,
        )
        return self._solved(composed, found) if self._varying else composed

    def psi(self, x: Array) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,), without any linear program."""
        self._x[:] = x
        self._bound.call()
        return self._found[: self._degree].copy()

    def _solved(self, composed: ComposedNumbers, found: Array) -> ComposedNumbers:
        """Add the linear programs of members whose U_l depends on the state."""
        polytopes = dict(composed.polytopes)
        for l in self._varying:
            row, c = found[self._ends[l]], composed.c[l]
            A, b = np.split(row, [len(row) * len(c) // (len(c) + 1)])
            polytopes[l] = polytope(A.reshape(len(b), -1), b)
            composed.least[l], composed.most[l] = extremes(c, polytopes[l].corners)
        return replace(composed, polytopes=polytopes)
