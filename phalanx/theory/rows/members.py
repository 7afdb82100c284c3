"""Members' output positions and the linear programs over their inputs, evaluated kind by kind."""

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.safety.composition import Member, stacked_slices


class MemberKind:
    """Dynamics with the same expressions."""

    def __init__(self, dynamics: Dynamics) -> None:
        """Raises EmptyPolytopeError: a constant input polytope is empty or unbounded."""
        x, c = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("c", len(dynamics.inputs))
        A, b = dynamics.input_polytope(x)
        self.polytope = constant_polytope(A, b)
        self.x, self._p = x, dynamics.position(x)
        self._f, self._g = dynamics.drift(x), dynamics.actuation(x)
        self.inputs = c.numel()
        """m"""
        if self.polytope is None:
            self.corners, self.row, self._outputs = np.zeros(0), [x], [A, b]
        else:
            # Corners are arguments, so that dynamics with other bounds are of this kind too.
            self.corners = self.polytope.corners.ravel()
            corners = ca.SX.sym("corners", *self.polytope.corners.shape)
            values = corners @ c
            self.row, self._outputs = [c, ca.vec(corners.T)], [ca.mmin(values), ca.mmax(values)]

    @cached_property
    def position(self) -> MappedFunction:
        """p as a function of the state."""
        return MappedFunction([self.x], [self._p])

    @cached_property
    def extremes(self) -> MappedFunction:
        """min and max of c u over U as a function of c and corners; A and b of x if U varies."""
        return MappedFunction(self.row, self._outputs)

    @cached_property
    def text(self) -> str:
        """Serialized expressions: different for different kinds."""
        outputs = [ca.densify(o) for o in (self._p, self._f, self._g, *self._outputs)]
        varying = self.polytope is None
        row = self.row if varying else [self.x, *self.row]
        text: str = ca.Function("member", [ca.vertcat(*row)], outputs).serialize()
        return text


class SwarmMembers:
    """The members of a swarm: the kind of each, and the indices of its numbers."""

    def __init__(self, members: Sequence[Member], after: int = 0) -> None:
        """after: count of other numbers between the states and the corners.

        Raises EmptyPolytopeError: a constant input polytope is empty or unbounded.
        """
        kind_by_id: dict[int, MemberKind] = {}
        for m in members:
            if id(m.dynamics) not in kind_by_id:
                kind_by_id[id(m.dynamics)] = MemberKind(m.dynamics)
        by_text: dict[str, int] = {}
        number = {key: by_text.setdefault(k.text, len(by_text)) for key, k in kind_by_id.items()}
        self.kind_of: Index = np.array([number[id(m.dynamics)] for m in members], dtype=np.intp)
        """Index of each member's kind in `kinds`."""
        first = {number[key]: kind for key, kind in reversed(kind_by_id.items())}
        self.kinds = [first[k] for k in range(len(by_text))]
        polytopes = [kind_by_id[id(m.dynamics)].polytope for m in members]
        self.constant_polytopes = {
            l: polytope for l, polytope in enumerate(polytopes) if polytope is not None
        }
        """U_l of the members that have a constant one."""
        self.states = stacked_slices([len(m.dynamics.states) for m in members])
        self.inputs = stacked_slices([len(m.dynamics.inputs) for m in members])
        begin = self.states[-1].stop + after
        where = stacked_slices([len(kind.corners) for kind in kind_by_id.values()])
        indices = {key: begin + np.r_[part] for key, part in zip(kind_by_id, where, strict=True)}
        self.corners: Array = np.concatenate([kind.corners for kind in kind_by_id.values()])
        """Corners of each dynamics' U, one after the other."""
        self._corners = [indices[id(m.dynamics)] for m in members]
        self.length = begin + len(self.corners)
        """Count of the numbers: the states, others, and the corners."""

    def arguments(self, kind: int, members: Sequence[int]) -> Index:
        """Indices of the corners of U for members of a kind; or of their states, if U varies."""
        if self.kinds[kind].polytope is None:
            return self.state_indices(members)
        return np.stack([self._corners[l] for l in members])

    def state_indices(self, members: Sequence[int]) -> Index:
        """Indices of the states of members of one kind, row by row."""
        return np.stack([np.r_[self.states[l]] for l in members])

    def by_kind(self, in_sight: Sequence[int]) -> dict[int, list[int]]:
        """The members in sight of each kind, those with a constant U first."""
        groups: dict[int, list[int]] = {}
        for l in sorted(in_sight, key=lambda l: l not in self.constant_polytopes):
            groups.setdefault(int(self.kind_of[l]), []).append(l)
        return groups


class Positions:
    """Output positions of fixed members at one state after another."""

    def __init__(self, swarm: SwarmMembers, in_sight: Sequence[int]) -> None:
        self._groups = [
            (members, swarm.kinds[kind].position.at(swarm.state_indices(members)))
            for kind, members in swarm.by_kind(in_sight).items()
        ]

    def __call__(self, x: Array) -> dict[int, Array]:
        """Evaluate at the stacked state x, shape (n̄,); output positions by member [m]."""
        positions: dict[int, Array] = {}
        for members, rows in self._groups:
            rows(x)
            positions |= zip(members, rows.results.copy(), strict=True)
        return positions
