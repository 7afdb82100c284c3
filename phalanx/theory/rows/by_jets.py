"""Terms of h_tot from the derivatives of each pair's h along the drift: h, L_f h, ..., L_f^q h.

The indices of the pairs' and members' numbers are arguments. So the function grows with the number
of kinds only, and serves all agents that see as many of each kind: with constant indices each set
of agents in sight would be a function of its own, compiled in the middle of a run. Each step
gathers its arguments from the results of those before it::

    numbers    states | obstacles' parameters | corners of each U
    jets       h, L_f h, ..., forces of pair 0 | those of pair 1 | ... | FAR | 0
    results    ψ_0 ... ψ_{q-1}, unforced | c of all members | extremes of c u

A step has room for more rows than it needs, so that few sizes are compiled. Unused rows repeat the
first one, and what would be composed of them reads FAR and 0 instead.
"""

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Index
from phalanx.theory.expressions.compiled import rounded_up
from phalanx.theory.rows.members import SwarmMembers
from phalanx.theory.safety.composition import FAR
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.kinds import PairKind
from phalanx.theory.safety.pairs import ChosenPairs

MembersByKind = Sequence[tuple[int, Sequence[int]]]
"""(number of a kind, members of it)."""


class _Shape(NamedTuple):
    """Sizes that a function is compiled for."""

    pairs: tuple[tuple[int, int], ...]
    members: tuple[tuple[int, int], ...]
    room: int
    """Number of pairs that there is room for."""
    most: int
    """The most forces that contain one input."""


class _Gathered:
    """Numbers at indices; each list of indices becomes an argument of the function."""

    def __init__(self) -> None:
        self.arguments: list[ca.MX] = []

    def __call__(self, values: ca.MX, height: int, width: int) -> ca.MX:
        """The numbers as a matrix, with a column for each row of indices."""
        self.arguments.append(ca.MX.sym("indices", height * width))
        return ca.reshape(values[self.arguments[-1]], height, width)


class TermsByJets:
    """Builder of functions that compute terms, one for each number of pairs and members."""

    def __init__(
        self, kinds: Sequence[PairKind], members: SwarmMembers, jets: LogSumExpJets
    ) -> None:
        """kinds: of the swarm's pairs."""
        self.kinds, self.members, self.jets = kinds, members, jets
        self._functions = cache(self._make)

    def function(
        self, members: MembersByKind, pairs: ChosenPairs
    ) -> tuple[ca.Function, list[Index]]:
        """The function of the numbers and of indices, for these members and pairs; these indices.

        Its results: ψ_0 ... ψ_{q-1} and the unforced part; c of all members; and for each the least
        and most of c u, or A and b of a U that varies with the state.
        """
        q, swarm = self.jets.degree, self.members
        c, count = self.layout(
            [(swarm.kinds[k].inputs, kind_members) for k, kind_members in members], 0
        )
        jets = _Jets(self, pairs)
        owners = np.full(swarm.inputs[-1].stop, -1)
        for l, part in c.items():
            owners[swarm.inputs[l]] = np.r_[part]
        pushes = _lists(owners[pairs.force_input], count)
        weights = np.append(pairs.force_pair * q + q - 1, 0)
        tables = [_filled(g.indices, rounded_up(len(g.indices))) for g in pairs.groups]
        tables += [jets.h, jets.forces[pushes], weights[pushes]]
        for k, kind_members in members:
            tables.append(_filled(swarm.arguments(k, kind_members), rounded_up(len(kind_members))))
        shape = _Shape(
            tuple((group.number, rounded_up(len(group.pairs))) for group in pairs.groups),
            tuple((k, rounded_up(len(kind_members))) for k, kind_members in members),
            len(jets.h),
            len(pushes),
        )
        return self._functions(shape), tables

    def _make(self, shape: _Shape) -> ca.Function:
        q, chosen = self.jets.degree, _Gathered()
        numbers = ca.MX.sym("numbers", self.members.length)
        results = []
        for k, room in shape.pairs:
            function = self.kinds[k].jets
            results.append(ca.vec(function.mapped(room)(chosen(numbers, function.inputs, room))))
        jets = ca.vertcat(*results, ca.MX(FAR), 0.0)
        chain, weights = self.jets.composition(shape.room)(chosen(jets, q + 1, shape.room))
        inputs = sum(self.members.kinds[k].inputs * room for k, room in shape.members)
        forces = chosen(jets, inputs, shape.most)
        c = ca.sum2(forces * chosen(ca.vec(weights), inputs, shape.most))
        ends = self._extremes(numbers, c, shape.members, chosen)
        return ca.Function("terms", [numbers, *chosen.arguments], [ca.vertcat(chain, c, *ends)])

    def layout(self, sizes: MembersByKind, begin: int) -> tuple[dict[int, slice], int]:
        """The slice of each member's numbers, from `begin` on, and their end.

        sizes: (count of numbers, members with as many).
        """
        slices: dict[int, slice] = {}
        for size, group in sizes:
            slices |= {
                l: slice(begin + n * size, begin + (n + 1) * size) for n, l in enumerate(group)
            }
            begin += size * rounded_up(len(group))
        return slices, begin

    def _extremes(
        self, numbers: ca.MX, c: ca.MX, rooms: Sequence[tuple[int, int]], chosen: _Gathered
    ) -> list[ca.MX]:
        """Least and most of c u, or A and b; rooms: (number of a kind, room for its members)."""
        ends, begin = [], 0
        for k, room in rooms:
            kind = self.members.kinds[k]
            columns = ca.reshape(
                c[begin : (begin := begin + kind.inputs * room)], kind.inputs, room
            )
            if kind.polytope is None:
                row = chosen(numbers, kind.x.numel(), room)
            else:
                row = ca.vertcat(columns, chosen(numbers, len(kind.corners), room))
            ends.append(ca.vec(kind.extremes.mapped(room)(row)))
        return ends


class _Jets:
    """Indices of the jets among the results of all groups, which have room for more pairs."""

    def __init__(self, by_jets: TermsByJets, pairs: ChosenPairs) -> None:
        q, begin = by_jets.jets.degree, 0
        h, forces = list[Index](), list[Index]()
        for group in pairs.groups:
            width = group.kind.jets.results
            rows = begin + np.arange(len(group.pairs) * width).reshape(-1, width)
            h.append(rows[:, : q + 1])
            forces.append(rows[:, q + 1 :].ravel())
            begin += rounded_up(len(group.pairs)) * width
        # The results end with FAR and zero: the jets of an unused pair, and an unused force.
        unused, count = np.array([[begin] + [begin + 1] * q]), len(pairs.pairs)
        self.h = np.concatenate([*h, unused.repeat(rounded_up(count) - count, axis=0)])
        """h, L_f h, ..., L_f^q h, shape (room, q+1)."""
        self.forces = np.concatenate([*forces, [begin + 1]]).astype(np.intp)
        """In the order of ChosenPairs, shape (f+1,); the last one is unused."""


def _filled(indices: Index, room: int) -> Index:
    """Fill the room up with copies of the first row."""
    return np.concatenate([indices, indices[:1].repeat(room - len(indices), axis=0)])


def _lists(owners: Index, count: int) -> Index:
    """Indices k with owners[k] = c in column c, shape (most, count), filled with len(owners)."""
    order = np.argsort(owners, kind="stable")
    sizes = np.bincount(owners, minlength=count)
    table = np.full((rounded_up(int(sizes.max(initial=0))), count), len(owners))
    rank = np.arange(len(owners)) - (np.cumsum(sizes) - sizes)[owners[order]]
    table[rank, owners[order]] = order
    return table
