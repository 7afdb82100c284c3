"""Pairs by kind: one function for each combination of dynamics and sides, not for each pair.

A swarm has few kinds of pairs however many agents it has. The h of a kind is a function of its
members' states and, for a sphere, of the sphere's center and size. So no expression grows with the
swarm, and all pairs of a kind are evaluated in one call.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.portable import factor_out
from phalanx.theory.expressions.user_methods import call_for_expression
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.safety.chain import degree_above, inputs_appear
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.function import Body, SafeSetFunction, Static, static_h
from phalanx.theory.safety.obstacles import Sphere

_TRIED = (0.37, -1.91, 5.3)
"""Spheres of symbols and of numbers are compared at the states (1, 2, ...) times each of these."""
_EQUAL = 1e-9


@dataclass(frozen=True)
class PairKind:
    """h of a normal agent and another agent or an obstacle, and its derivatives."""

    dynamics: tuple[Dynamics, ...]
    """One with an obstacle or limit, else two."""
    x: tuple[ca.SX, ...]
    """The members' states, shapes (n_l,)."""
    parameters: ca.SX
    """Symbols for the obstacle's numbers, shape (k,); empty for other kinds."""
    h: ca.SX

    @property
    def row(self) -> list[ca.SX]:
        """All symbols of the expressions."""
        return [*self.x, self.parameters]

    @property
    def sizes(self) -> list[int]:
        """Number of states of each member, then number of parameters."""
        return [*[x.numel() for x in self.x], self.parameters.numel()]

    @cached_property
    def text(self) -> str:
        """Serialized h and dynamics of the members: different for different kinds."""
        parts = [
            part
            for d, x in zip(self.dynamics, self.x, strict=True)
            for part in (d.drift(x), ca.vec(ca.densify(d.actuation(x))))
        ]
        outputs = [self.h, *[ca.densify(part) for part in parts]]
        found: str = ca.Function("kind", [ca.vertcat(*self.row)], outputs).serialize()
        return found

    def along_drift(self, degree: int) -> list[ca.SX]:
        """h, L_f h, ..., L_f^degree h."""
        f = [d.drift(x) for d, x in zip(self.dynamics, self.x, strict=True)]
        found = [self.h]
        for _ in range(degree):
            rate = ca.SX(0)
            for x, own in zip(self.x, f, strict=True):
                rate += ca.jacobian(found[-1], x) @ own
            found.append(rate)
        return found

    def actuation(self, degree: int) -> list[ca.SX]:
        """L_{g_l} L_f^{degree-1} h of each member, shapes (1, m_l)."""
        last = self.along_drift(degree - 1)[-1]
        return [
            ca.sparsify(ca.simplify(ca.jacobian(last, x) @ d.actuation(x)))
            for d, x in zip(self.dynamics, self.x, strict=True)
        ]


class SharedJets(NamedTuple):
    """Jets in two steps: terms of one member alone are computed once for all its pairs."""

    parts: tuple[MappedFunction | None, ...]
    """Functions of each member's state; None if there are no such terms."""
    jets: MappedFunction
    """Function of a pair's row, followed by its members' parts."""


class CompiledKind:
    """A kind's functions, each compiled on first use."""

    def __init__(self, kind: PairKind, degree: int) -> None:
        """degree: q."""
        self.kind, self._degree = kind, degree

    @cached_property
    def h(self) -> MappedFunction:
        """h alone."""
        return MappedFunction(self.kind.row, [self.kind.h])

    @cached_property
    def along_drift(self) -> MappedFunction:
        """h, L_f h, ..., L_f^{q-1} h."""
        return MappedFunction(self.kind.row, self.kind.along_drift(self._degree - 1))

    @cached_property
    def jets(self) -> MappedFunction:
        """h, L_f h, ..., L_f^q h; then L_{g_l} L_f^{q-1} h of each member."""
        q, kind = self._degree, self.kind
        return MappedFunction(kind.row, [*kind.along_drift(q), *kind.actuation(q)])

    @cached_property
    def shared(self) -> SharedJets:
        """The jets with the terms of one member alone factored out."""
        q, kind = self._degree, self.kind
        jets = [ca.vec(o.T) for o in map(ca.densify, (*kind.along_drift(q), *kind.actuation(q)))]
        parts, symbols, rest = factor_out(kind.x, kind.parameters, ca.vertcat(*jets))
        return SharedJets(
            tuple(
                MappedFunction([x], [own]) if own.numel() else None
                for x, own in zip(kind.x, parts, strict=True)
            ),
            MappedFunction([*kind.row, *symbols], [rest]),
        )

    @cached_property
    def gradients(self) -> MappedFunction:
        """Gradients of h, L_f h, ..., L_f^{q-1} h by the members' states, one after the other."""
        x = ca.vertcat(*self.kind.x)
        values = self.kind.along_drift(self._degree - 1)
        return MappedFunction(self.kind.row, [ca.jacobian(value, x) for value in values])


def pair_kind(a: Member, b: Member | Static, function: SafeSetFunction) -> PairKind:
    """The kind of a normal member a and another member, obstacle or limit."""
    own, body = _body(a)
    if isinstance(b, Member):
        other, there = _body(b)
        h = call_for_expression(function, "between", [()], body, there, symbols=[own, other])
        return PairKind((a.dynamics, b.dynamics), (own, other), ca.SX(0, 1), h)
    none = ca.SX(0, 1)
    return PairKind((a.dynamics,), (own,), none, static_h(function, body, b, none))


def sphere_kind(a: Member, spheres: list[Sphere], function: SafeSetFunction) -> PairKind | None:
    """The kind of a normal member and any of these spheres, whose numbers are its parameters.

    None if the function raises for a sphere of symbols, or if its h depends on more of a sphere
    than center and clearance.
    """
    own, body = _body(a)
    sphere, parameters = any_sphere(spheres[0])
    try:
        h = ca.SX(function.to_obstacle(body, sphere))
        of_any = ca.Function("h", [own, parameters], [h])
        for sphere in spheres:
            of_this = ca.Function("h", [own], [function.to_obstacle(body, sphere)])
            for factor in _TRIED:
                x = factor * np.arange(1.0, own.numel() + 1.0)
                found, expected = float(of_any(x, parameters_of(sphere))), float(of_this(x))
                if not abs(found - expected) <= _EQUAL * (1.0 + abs(expected)):
                    return None
    except Exception:  # of a user's function, which is called again with the sphere itself
        return None
    return PairKind((a.dynamics,), (own,), parameters, h)


def any_sphere(like: Sphere) -> tuple[Sphere, ca.SX]:
    """A sphere of symbols with as many dimensions as `like`; and these symbols."""
    center, clearance = ca.SX.sym("center", len(like.center)), ca.SX.sym("clearance")
    sphere = Sphere(tuple(ca.vertsplit(center)), clearance)  # type: ignore[arg-type]
    return sphere, ca.vertcat(center, clearance)


def parameters_of(obstacle: Static) -> Array:
    """The numbers of an obstacle that are parameters of its kind, shape (k,)."""
    if isinstance(obstacle, Sphere):
        return np.array([*obstacle.center, obstacle.clearance])
    return np.zeros(0)


def _body(member: Member) -> tuple[ca.SX, Body]:
    dynamics = member.dynamics
    x = ca.SX.sym("x", len(dynamics.states))
    return x, Body(x, dynamics.position(x), tuple(dynamics.states), member.adversary)


def member_classes(members: Sequence[Member]) -> tuple[list[Member], Index]:
    """Classes of members with equal dynamics and side: the first of each; each member's class."""
    classes: list[Member] = []
    found = []
    for member in members:
        equal = (
            number
            for number, other in enumerate(classes)
            if other.adversary == member.adversary and other.dynamics == member.dynamics
        )
        found.append(next(equal, len(classes)))
        if found[-1] == len(classes):
            classes.append(member)
    return classes, np.array(found)


def kind_table(
    classes: Sequence[Member],
    of_member: Index,
    obstacles: Sequence[Static],
    function: SafeSetFunction,
) -> tuple[list[PairKind], Index]:
    """The different kinds; and the number of that of each class with each side, -1 if none."""
    kinds: list[PairKind] = []
    by_text: dict[str, int] = {}
    table = np.full((len(classes), len(classes) + len(obstacles)), -1)
    for a, own in enumerate(classes):
        if own.adversary:
            continue
        sides: list[tuple[int, PairKind]] = [
            (b, pair_kind(own, other, function))
            for b, other in enumerate(classes)
            # In a pair of two normal members the lower index comes first.
            if other.adversary or (of_member == a).argmax() < np.flatnonzero(of_member == b)[-1]
        ]
        sides += enumerate(_static_kinds(own, obstacles, function), start=len(classes))
        for b, kind in sides:
            table[a, b] = by_text.setdefault(kind.text, len(kinds))
            if table[a, b] == len(kinds):
                kinds.append(kind)
    return kinds, table


def _static_kinds(
    own: Member, obstacles: Sequence[Static], function: SafeSetFunction
) -> list[PairKind]:
    """The kinds of one class with every obstacle and limit."""
    spheres = [obstacle for obstacle in obstacles if isinstance(obstacle, Sphere)]
    shared = sphere_kind(own, spheres, function) if spheres else None
    return [
        shared if shared and isinstance(o, Sphere) else pair_kind(own, o, function)
        for o in obstacles
    ]


def require_degree(
    members: Sequence[Member],
    classes: Index,
    kinds: Sequence[PairKind],
    table: Index,
    gains: int,
) -> None:
    """Raise RelativeDegreeError unless the inputs of all members appear at degree `gains`."""
    for degree in range(1, gains + 1):
        forces = [kind.actuation(degree) for kind in kinds]
        appeared = set()
        for a, b in np.argwhere(table >= 0).tolist():
            sides = zip((a, b), forces[table[a, b]], strict=False)
            appeared |= {side for side, force in sides if force.nnz() > 0}
        if inputs_appear(members, [c in appeared for c in classes.tolist()], degree, gains):
            return
    raise degree_above(gains)
