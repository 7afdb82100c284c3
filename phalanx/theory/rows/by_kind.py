"""Terms of h_tot as one function of the state, of as many pairs and members of each kind.

Whose numbers it takes, and where they lie, is an argument: so it grows with nothing but kinds, and
serves all who see as many.
"""

from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.mapped import MappedFunction
from phalanx.theory.rows.members import SwarmMembers
from phalanx.theory.safety.composition import FAR
from phalanx.theory.safety.jets import LogSumExpJets
from phalanx.theory.safety.pairs import SwarmPairs


class Shape(NamedTuple):
    """What a function is made for."""

    parts: tuple[tuple[int, int], ...]
    """(number of the function, room) of members' parts; below of kinds of pairs and of members."""
    pairs: tuple[tuple[int, int], ...]
    members: tuple[tuple[int, int], ...]
    room: int
    """For pairs."""
    most: int
    """Forces that one input has a part in."""


class TermsByKind:
    """The functions of one swarm, by what there is room for."""

    def __init__(self, pairs: SwarmPairs, members: SwarmMembers, jets: LogSumExpJets) -> None:
        self.pairs, self.members, self.jets = pairs, members, jets
        self.numbers: Array = np.concatenate(
            [np.zeros(pairs.states), pairs.parameters, members.corners]
        )
        """What a function takes: the state, obstacles and the corners of each U."""
        self._functions: dict[Shape, ca.Function] = {}

    @cached_property
    def parts_of(self) -> list[list[MappedFunction | None]]:
        """By kind of pair, of each of its members: what is the same in all its pairs."""
        by_text: dict[str, MappedFunction] = {}
        return [
            [part and by_text.setdefault(part.text, part) for part in kind.shared.parts]
            for kind in self.pairs.kinds
        ]

    @cached_property
    def parts(self) -> list[MappedFunction]:
        """The different ones among them."""
        every = [part for own in self.parts_of for part in own if part]
        return list({id(part): part for part in every}.values())

    def function(self, shape: Shape) -> ca.Function:
        """Of the numbers and the places in them and in what is made of them."""
        if shape not in self._functions:
            self._functions[shape] = self._make(shape)
        return self._functions[shape]

    def _make(self, shape: Shape) -> ca.Function:
        q, places = self.pairs.degree, list[ca.MX]()
        numbers = ca.MX.sym("numbers", len(self.numbers))

        def chosen(values: ca.MX, height: int, width: int) -> ca.MX:
            places.append(ca.MX.sym("places", height * width))
            return ca.reshape(values[places[-1]], height, width)

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
        weights = ca.vec(weights)
        kinds = [(self.members.kinds[k], room) for k, room in shape.members]
        inputs = sum(kind.inputs * room for kind, room in kinds)
        pushes = chosen(jets, inputs, shape.most) * chosen(weights, inputs, shape.most)
        c, ends, begin = ca.sum2(pushes), [], 0
        for kind, room in kinds:
            own = ca.reshape(c[begin : (begin := begin + kind.inputs * room)], kind.inputs, room)
            if kind.polytope is None:
                row = chosen(numbers, kind.x.numel(), room)
            else:
                row = ca.vertcat(own, chosen(numbers, len(kind.corners), room))
            ends.append(ca.vec(kind.extremes.mapped(room)(row)))
        return ca.Function("terms", [numbers, *places], [ca.vertcat(chain, c, *ends, weights)])
