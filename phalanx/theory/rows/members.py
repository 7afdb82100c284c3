"""Members' output positions and the linear programs over their inputs, evaluated kind by kind."""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.mapped import MappedFunction, MappedRows
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import Polytope, constant_polytope, extremes, polytope
from phalanx.theory.safety.composition import Member, stacked_slices


class InputExtremes(NamedTuple):
    """Of the members that are seen at one state, by index."""

    least: dict[int, float]
    """min over U_l of c_l u, Eq. (LPvminmax)."""
    most: dict[int, float]
    """max over U_l of c_l u."""
    polytopes: dict[int, Polytope]
    """U_l."""


class _Kind:
    """Dynamics of which these are the same expressions."""

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises EmptyPolytopeError: a constant input polytope is empty or unbounded."""
        x, c = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("c", len(dynamics.inputs))
        A, b = dynamics.input_polytope(x)
        self.polytope = constant_polytope(A, b)
        corners = ca.SX(0, c.numel())
        self.position, self.extremes = dynamics.position(x), [A, b]
        if self.polytope is not None:
            # Numbers, so that dynamics with other bounds are of this kind too.
            corners = ca.SX.sym("corners", *self.polytope.corners.shape)
            values = corners @ c
            self.extremes = [ca.mmin(values), ca.mmax(values)]
        self.x, self.row = x, [x, c, ca.vec(corners.T)]

    @property
    def corners(self) -> Array:
        """Of its own U, flat; none if it varies."""
        return np.zeros(0) if self.polytope is None else self.polytope.corners.ravel()

    @cached_property
    def text(self) -> str:
        """What tells kinds apart."""
        outputs = [ca.densify(o) for o in (self.position, *self.extremes)]
        found: str = ca.Function("member", [ca.vertcat(*self.row)], outputs).serialize()
        return found


class _Compiled(NamedTuple):
    """One kind's functions of rows of numbers."""

    position: MappedFunction
    extremes: MappedFunction
    """Of a constant U; of one that varies its A and b."""


class SwarmMembers:
    """The members of a swarm: of each its kind, and where its numbers lie."""

    def __init__(self, members: Sequence[Member], after: int = 0) -> None:
        """after: how many other numbers there are between the states and what comes in here.

        Raises EmptyPolytopeError: a constant input polytope is empty or unbounded.
        """
        each: dict[int, _Kind] = {}
        for m in members:
            if id(m.dynamics) not in each:
                each[id(m.dynamics)] = _Kind(m.dynamics)
        compiled = {
            kind.text: _Compiled(
                MappedFunction([kind.x], [kind.position]), MappedFunction(kind.row, kind.extremes)
            )
            for kind in each.values()
        }
        self.kinds = [each[id(m.dynamics)] for m in members]
        self.functions = [compiled[kind.text] for kind in self.kinds]
        self.known = {l: k.polytope for l, k in enumerate(self.kinds) if k.polytope is not None}
        """U_l of the members for whom it is constant."""
        self.states = stacked_slices([len(m.dynamics.states) for m in members])
        self.inputs = stacked_slices([len(m.dynamics.inputs) for m in members])
        begin = self.states[-1].stop + after
        self.c = slice(begin, begin + self.inputs[-1].stop)
        """Where all c_l lie, stacked; after them come the corners of each dynamics' U."""
        corners = [kind.corners for kind in each.values()]
        where = dict(zip(each, stacked_slices([len(c) for c in corners]), strict=True))
        self.corners: Array = np.concatenate(corners)
        self.places: list[Index] = [
            np.concatenate(
                [np.r_[x], begin + np.r_[u], self.c.stop + np.r_[where[id(m.dynamics)]]]
            ).astype(np.intp)
            for m, x, u in zip(members, self.states, self.inputs, strict=True)
        ]

    def choose(self, seen: Sequence[int]) -> "ChosenMembers":
        """Members that are seen together."""
        return ChosenMembers(self, seen)


class _Group(NamedTuple):
    """Members of one kind."""

    members: list[int]
    kind: _Kind
    position: MappedRows
    extremes: MappedRows


class ChosenMembers:
    """Members to evaluate at one state after another."""

    def __init__(self, swarm: SwarmMembers, seen: Sequence[int]) -> None:
        self._swarm = swarm
        groups: dict[int, list[int]] = {}
        for l in seen:
            groups.setdefault(id(swarm.functions[l]), []).append(l)
        self._groups = [self._group(members) for members in groups.values()]

    def _group(self, members: list[int]) -> _Group:
        swarm, first = self._swarm, members[0]
        kind, compiled = swarm.kinds[first], swarm.functions[first]
        places = np.stack([swarm.places[l] for l in members])
        position = compiled.position.at(places[:, : kind.x.numel()])
        return _Group(members, kind, position, compiled.extremes.at(places))

    def positions(self, x: Array) -> dict[int, Array]:
        """Output positions [m] at the stacked state x, shape (n̄,)."""
        found: dict[int, Array] = {}
        for members, _, position, _ in self._groups:
            position(x)
            found.update(zip(members, position.results.copy(), strict=True))
        return found

    def extremes(self, numbers: Array) -> InputExtremes:
        """At states, c and corners, which lie where SwarmMembers has them."""
        swarm = self._swarm
        varying = len(swarm.known) < len(swarm.kinds)
        found = InputExtremes({}, {}, dict(swarm.known) if varying else swarm.known)
        for members, kind, _, rows in self._groups:
            rows(numbers)
            if kind.polytope is None:
                self._solve(members, rows.results, numbers[swarm.c], found)
            else:
                least, most = rows.results.T.tolist()
                found.least.update(zip(members, least, strict=True))
                found.most.update(zip(members, most, strict=True))
        return found

    def _solve(self, members: list[int], rows: Array, c: Array, found: InputExtremes) -> None:
        """The linear programs of members whose U_l is what it is at this state only."""
        for l, row in zip(members, rows, strict=True):
            own = c[self._swarm.inputs[l]]
            A, b = np.split(row, [len(row) * len(own) // (len(own) + 1)])
            found.polytopes[l] = polytope(A.reshape(len(b), -1), b)
            found.least[l], found.most[l] = extremes(own, found.polytopes[l].corners)
