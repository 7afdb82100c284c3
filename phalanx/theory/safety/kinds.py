"""Pairs by kind: one function for each combination of dynamics and sides, not for each pair.

A swarm has few kinds of pairs however many agents it has. The h of a kind is a function of its
members' states and, for a sphere, of the sphere's center and size. So no expression grows with the
swarm, and all pairs of a kind are evaluated in one call.
"""

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.user_methods import is_built_in
from phalanx.theory.models.dynamics import motion_texts
from phalanx.theory.safety.chain import degree_above, inputs_appear
from phalanx.theory.safety.composition import ComposedSet, Member, of_pair
from phalanx.theory.safety.function import SafeSetFunction, Static
from phalanx.theory.safety.obstacles import Sphere

_TRIED = (0.37, -1.91, 5.3)
"""Spheres of symbols and of numbers are compared at the states (1, 2, ...) times each of these."""
_EQUAL = 1e-9


class PairKind:
    """All pairs with the expressions of one of them; its functions are compiled on first use."""

    def __init__(self, pair: ComposedSet, degree: int) -> None:
        """pair: one of the kind, whose obstacle's numbers may be symbols. degree: q."""
        self.pair, self._degree = pair, degree
        self._row = [pair.x, pair.parameters]

    @cached_property
    def text(self) -> str:
        """Serialized h and dynamics of the members: different for different kinds."""
        pair = self.pair
        parts = [pair.h]
        for member, index in zip(pair.members, pair.parts, strict=True):
            x, dynamics = pair.x[index], member.dynamics
            parts += [dynamics.drift(x), ca.vec(ca.densify(dynamics.actuation(x)))]
        outputs = [ca.densify(part) for part in parts]
        text: str = ca.Function("kind", [ca.vertcat(*self._row)], outputs).serialize()
        return text

    @cached_property
    def h(self) -> MappedFunction:
        """h alone."""
        return MappedFunction(self._row, [self.pair.h])

    @cached_property
    def along_drift(self) -> MappedFunction:
        """h, L_f h, ..., L_f^{q-1} h."""
        return MappedFunction(self._row, _along_drift(self.pair, self._degree - 1))

    @cached_property
    def jets(self) -> MappedFunction:
        """h, L_f h, ..., L_f^q h; then L_{g_l} L_f^{q-1} h of each member."""
        drift, forces = _along_drift(self.pair, self._degree), _forces(self.pair, self._degree)
        return MappedFunction(self._row, [*drift, *forces])

    @cached_property
    def gradients(self) -> MappedFunction:
        """Gradients of h, L_f h, ..., L_f^{q-1} h by the members' states, one after the other."""
        values = _along_drift(self.pair, self._degree - 1)
        return MappedFunction(self._row, [ca.jacobian(value, self.pair.x) for value in values])


def _along_drift(pair: ComposedSet, degree: int) -> list[ca.SX]:
    """h, L_f h, ..., L_f^degree h."""
    x = [pair.x[index] for index in pair.parts]
    f = [member.dynamics.drift(state) for member, state in zip(pair.members, x, strict=True)]
    derivatives = [pair.h]
    for _ in range(degree):
        last = derivatives[-1]
        rates = [ca.jacobian(last, state) @ drift for state, drift in zip(x, f, strict=True)]
        derivatives.append(sum(rates, ca.SX(0)))
    return derivatives


def _forces(pair: ComposedSet, degree: int) -> list[ca.SX]:
    """L_{g_l} L_f^{degree-1} h of each member, shapes (1, m_l)."""
    last, forces = _along_drift(pair, degree - 1)[-1], []
    for member, index in zip(pair.members, pair.parts, strict=True):
        x = pair.x[index]
        gain = ca.jacobian(last, x) @ member.dynamics.actuation(x)
        forces.append(ca.sparsify(ca.simplify(gain)))
    return forces


def _of_spheres(a: Member, spheres: list[Sphere], function: SafeSetFunction) -> ComposedSet | None:
    """The pair of a normal member and any of these spheres, whose numbers are its parameters.

    None if the function raises for a sphere of symbols, or if its h depends on more of a sphere
    than center and clearance.
    """
    try:
        pair = with_any_sphere(a, spheres[0], function)
        if is_built_in(function):
            return pair
        of_any = ca.Function("h", [pair.x, pair.parameters], [pair.h])
        for sphere in spheres:
            h = function.to_obstacle(pair.bodies[0], sphere)
            of_this = ca.Function("h", [pair.x], [h])
            for factor in _TRIED:
                x = factor * np.arange(1.0, pair.x.numel() + 1.0)
                value, expected = float(of_any(x, parameters_of(sphere))), float(of_this(x))
                if not abs(value - expected) <= _EQUAL * (1.0 + abs(expected)):
                    return None
    except Exception:  # of a user's function, which is called again with the sphere itself
        return None
    return pair


def with_any_sphere(a: Member, like: Sphere, function: SafeSetFunction) -> ComposedSet:
    """The pair of a normal member and a sphere of symbols, with as many dimensions as `like`."""
    sphere, numbers = with_symbols(like)
    return of_pair(a, sphere, function, numbers)


def with_symbols(obstacle: Static) -> tuple[Static, ca.SX]:
    """The obstacle with symbols in place of its parameters; and the symbols, shape (k,)."""
    if not isinstance(obstacle, Sphere):
        return obstacle, ca.SX(0, 1)
    center, clearance = ca.SX.sym("center", len(obstacle.center)), ca.SX.sym("clearance")
    sphere = Sphere(tuple(ca.vertsplit(center)), clearance)  # type: ignore[arg-type]
    return sphere, ca.vertcat(center, clearance)


def parameters_of(obstacle: Static) -> Array:
    """The numbers of an obstacle that are parameters of its kind, shape (k,)."""
    if isinstance(obstacle, Sphere):
        return np.array([*obstacle.center, obstacle.clearance])
    return np.zeros(0)


def member_classes(members: Sequence[Member]) -> tuple[list[Member], Index]:
    """Classes of equal motion, states and side: the first of each; then every member's class."""
    texts = motion_texts([m.dynamics for m in members])
    keys = [
        (text, tuple(m.dynamics.states), m.adversary)
        for text, m in zip(texts, members, strict=True)
    ]
    classes = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return [members[keys.index(key)] for key in classes], np.array([classes[key] for key in keys])


def kind_table(
    classes: Sequence[Member],
    of_member: Index,
    obstacles: Sequence[Static],
    function: SafeSetFunction,
    degree: int,
) -> tuple[list[PairKind], Index]:
    """The different kinds; and the number of that of each class with each side, -1 if none."""
    kinds: list[PairKind] = []
    by_text: dict[str, int] = {}
    table = np.full((len(classes), len(classes) + len(obstacles)), -1)
    for a, member in enumerate(classes):
        if member.adversary:
            continue
        sides = [
            (b, PairKind(of_pair(member, other, function), degree))
            for b, other in enumerate(classes)
            # In a pair of two normal members the lower index comes first.
            if other.adversary or (of_member == a).argmax() < np.flatnonzero(of_member == b)[-1]
        ]
        spheres = [obstacle for obstacle in obstacles if isinstance(obstacle, Sphere)]
        of_any = _of_spheres(member, spheres, function) if spheres else None
        shared = of_any and PairKind(of_any, degree)
        for b, obstacle in enumerate(obstacles, start=len(classes)):
            kind = shared if isinstance(obstacle, Sphere) else None
            sides.append((b, kind or PairKind(of_pair(member, obstacle, function), degree)))
        for b, kind in sides:
            table[a, b] = by_text.setdefault(kind.text, len(kinds))
            if table[a, b] == len(kinds):
                kinds.append(kind)
    return kinds, table


def require_degree(
    members: Sequence[Member],
    classes: Index,
    kinds: Sequence[PairKind],
    table: Index,
    gains: int,
) -> None:
    """Raise RelativeDegreeError unless the inputs of all members appear at degree `gains`."""
    for degree in range(1, gains + 1):
        forces = [_forces(kind.pair, degree) for kind in kinds]
        appeared = set()
        for a, b in np.argwhere(table >= 0).tolist():
            sides = zip((a, b), forces[table[a, b]], strict=False)
            appeared |= {side for side, force in sides if force.nnz() > 0}
        if inputs_appear(members, [c in appeared for c in classes.tolist()], degree, gains):
            return
    raise degree_above(gains)
