"""Which kind of pair two members, or a member and what stands still, make."""

from collections.abc import Sequence

import numpy as np

from phalanx.arrays import Index
from phalanx.theory.safety.chain import degree_above, inputs_appear
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.function import SafeSetFunction
from phalanx.theory.safety.kinds import PairKind, pair_kind, sphere_kind
from phalanx.theory.safety.obstacles import Sphere
from phalanx.theory.safety.static import Static


def member_classes(members: Sequence[Member]) -> tuple[list[Member], Index]:
    """Members that differ in dynamics or side, the first of each sort, and each member's class."""
    classes: list[Member] = []
    found = []
    for member in members:
        alike = (
            number
            for number, other in enumerate(classes)
            if other.adversary == member.adversary and other.dynamics == member.dynamics
        )
        found.append(next(alike, len(classes)))
        if found[-1] == len(classes):
            classes.append(member)
    return classes, np.array(found)


def kind_table(
    classes: Sequence[Member],
    of_member: Index,
    obstacles: Sequence[Static],
    function: SafeSetFunction,
) -> tuple[list[PairKind], Index]:
    """Kinds with different expressions; and which one a normal class has with what, or -1."""
    kinds: list[PairKind] = []
    by_text: dict[str, int] = {}
    table = np.full((len(classes), len(classes) + len(obstacles)), -1)
    for a, own in enumerate(classes):
        if own.adversary:
            continue
        sides: list[tuple[int, PairKind]] = [
            (b, pair_kind(own, other, function))
            for b, other in enumerate(classes)
            # Of two normal members the first one comes first.
            if other.adversary or (of_member == a).argmax() < np.flatnonzero(of_member == b)[-1]
        ]
        sides += enumerate(_beside(own, obstacles, function), start=len(classes))
        for b, kind in sides:
            table[a, b] = by_text.setdefault(kind.text, len(kinds))
            if table[a, b] == len(kinds):
                kinds.append(kind)
    return kinds, table


def _beside(own: Member, obstacles: Sequence[Static], function: SafeSetFunction) -> list[PairKind]:
    """The kinds of one class with every obstacle."""
    spheres = [obstacle for obstacle in obstacles if isinstance(obstacle, Sphere)]
    common = sphere_kind(own, spheres, function) if spheres else None
    return [
        common if common and isinstance(o, Sphere) else pair_kind(own, o, function)
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
