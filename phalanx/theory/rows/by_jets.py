"""Terms of h_tot from the derivatives of each pair's h along the drift: h, L_f h, ..., L_f^q h."""

from functools import cache, cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Index
from phalanx.theory.expressions.compiled import MappedFunction, rounded_up
from phalanx.theory.rows.composed_function import Gathered, MembersByKind, Placed, TermsByKind
from phalanx.theory.rows.members import SwarmMembers
from phalanx.theory.safety.composition import FAR
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.pairs import ChosenPairs, SwarmPairs


class _Shape(NamedTuple):
    """Sizes that a function is compiled for."""

    parts: tuple[tuple[int, int], ...]
    """(number, room) of the functions of members' parts; likewise below for kinds."""
    pairs: tuple[tuple[int, int], ...]
    members: tuple[tuple[int, int], ...]
    room: int
    """Number of pairs that there is room for."""
    most: int
    """The most forces that contain one input."""


class TermsByJets(TermsByKind):
    """Terms of a chain without D_k, of which ψ_k are functions of the jets."""

    def __init__(self, pairs: SwarmPairs, members: SwarmMembers, jets: LogSumExpJets) -> None:
        super().__init__(pairs, members)
        self.jets, self._made = jets, cache(self._make)

    def room(self, count: int) -> int:
        return rounded_up(count)

    @cached_property
    def parts_of(self) -> list[list[MappedFunction | None]]:
        """The functions of one member alone, by kind of pair and member; None if there is none."""
        by_text: dict[str, MappedFunction] = {}
        return [
            [part and by_text.setdefault(part.text, part) for part in kind.shared.parts]
            for kind in self.pairs.kinds
        ]

    @cached_property
    def parts(self) -> list[MappedFunction]:
        """The different functions among parts_of."""
        every = [part for own in self.parts_of for part in own if part]
        return list({id(part): part for part in every}.values())

    def function(self, members: MembersByKind, pairs: ChosenPairs) -> Placed:
        q, each = self.pairs.degree, self.members
        c, count = self.layout([(each.kinds[k].inputs, own) for k, own in members], 0)
        parts, jets = _Parts(self, pairs), _Jets(self, pairs)
        owners = np.full(each.inputs[-1].stop, -1)
        for l, part in c.items():
            owners[each.inputs[l]] = np.r_[part]
        pushes = _lists(owners[pairs.force_input], count)
        weights = np.append(pairs.force_pair * q + q - 1, 0)
        tables = list(parts.tables)
        for group in pairs.groups:
            places = np.concatenate([group.places, *parts.of(group.number, group.pairs)], axis=1)
            tables.append(_filled(places, rounded_up(len(places))))
        tables += [jets.h, jets.forces[pushes], weights[pushes]]
        for k, own in members:
            tables.append(_filled(each.arguments(k, own), rounded_up(len(own))))
        shape = _Shape(
            parts.shape,
            tuple((group.number, rounded_up(len(group.pairs))) for group in pairs.groups),
            tuple((k, rounded_up(len(own))) for k, own in members),
            len(jets.h),
            len(pushes),
        )
        return self._made(shape), tables

    def _make(self, shape: _Shape) -> ca.Function:
        q, chosen = self.pairs.degree, Gathered()
        numbers = ca.MX.sym("numbers", len(self.numbers))
        known, found = [numbers], []
        for k, room in shape.parts:
            part = self.parts[k]
            known.append(ca.vec(part.mapped(room)(chosen(numbers, part.inputs, room))))
        once = ca.vertcat(*known)
        for k, room in shape.pairs:
            function = self.pairs.kinds[k].shared.jets
            found.append(ca.vec(function.mapped(room)(chosen(once, function.inputs, room))))
        jets = ca.vertcat(*found, ca.MX(FAR), 0.0)
        chain, weights = self.jets.composition(shape.room)(chosen(jets, q + 1, shape.room))
        inputs = sum(self.members.kinds[k].inputs * room for k, room in shape.members)
        forces = chosen(jets, inputs, shape.most)
        c = ca.sum2(forces * chosen(ca.vec(weights), inputs, shape.most))
        ends = self.extremes(numbers, c, shape.members, chosen)
        return ca.Function("terms", [numbers, *chosen.places], [ca.vertcat(chain, 0.0, c, *ends)])


class _Jets:
    """Places of the jets among the results of all groups, which have room for more pairs."""

    def __init__(self, by_jets: TermsByJets, pairs: ChosenPairs) -> None:
        q, begin = by_jets.pairs.degree, 0
        h, forces = list[Index](), list[Index]()
        for group in pairs.groups:
            width = group.kind.shared.jets.results
            own = begin + np.arange(len(group.pairs) * width).reshape(-1, width)
            h.append(own[:, : q + 1])
            forces.append(own[:, q + 1 :].ravel())
            begin += rounded_up(len(group.pairs)) * width
        # The results end with FAR and zero: the jets of an unused pair, and an unused force.
        unused, count = np.array([[begin] + [begin + 1] * q]), len(pairs.pairs)
        self.h = np.concatenate([*h, unused.repeat(rounded_up(count) - count, axis=0)])
        """h, L_f h, ..., L_f^q h, shape (room, q+1)."""
        self.forces = np.concatenate([*forces, [begin + 1]]).astype(np.intp)
        """In the order of ChosenPairs, shape (f+1,); the last one is unused."""


class _Parts:
    """Places of the terms of one member alone, which all its pairs share."""

    def __init__(self, by_jets: TermsByJets, pairs: ChosenPairs) -> None:
        self._of, begin = by_jets.parts_of, len(by_jets.numbers)
        self._first: dict[int, Index] = {}
        self.tables: list[Index] = []
        """Places of the states that each function takes, row by row."""
        shape = []
        for number, part in enumerate(by_jets.parts):
            members = self._members(part, pairs)
            if not len(members):
                continue
            room = rounded_up(len(members))
            self.tables.append(_filled(by_jets.members.places(members.tolist()), room))
            shape.append((number, room))
            first = self._first[id(part)] = np.zeros(members[-1] + 1, dtype=np.intp)
            first[members] = begin + part.results * np.arange(len(members))
            begin += part.results * room
        self.shape = tuple(shape)

    def _members(self, part: MappedFunction, pairs: ChosenPairs) -> Index:
        """The members whose part is needed."""
        found = [
            group.pairs[:, side]
            for group in pairs.groups
            for side, own in enumerate(self._of[group.number])
            if own is part
        ]
        return np.unique(np.concatenate([np.zeros(0, dtype=np.intp), *found]))

    def of(self, kind: int, pairs: Index) -> list[Index]:
        """Places of the parts of both members, for pairs of a kind, shapes (r, k)."""
        return [
            self._first[id(part)][pairs[:, side]][:, None] + np.arange(part.results)
            for side, part in enumerate(self._of[kind])
            if part
        ]


def _filled(places: Index, room: int) -> Index:
    """Fill the room up with copies of the first row."""
    return np.concatenate([places, places[:1].repeat(room - len(places), axis=0)])


def _lists(owners: Index, count: int) -> Index:
    """Places k with owners[k] = c in column c, shape (most, count), filled with len(owners)."""
    order = np.argsort(owners, kind="stable")
    sizes = np.bincount(owners, minlength=count)
    table = np.full((rounded_up(int(sizes.max(initial=0))), count), len(owners))
    rank = np.arange(len(owners)) - (np.cumsum(sizes) - sizes)[owners[order]]
    table[rank, owners[order]] = order
    return table
