"""The distance at which two normal agents come to rest before one another, and what each term adds.

At rest a row is allowance + margin <= 0: agents that want to close in stop where it is 0.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.row_terms import ALLOWANCE, PairRowTerms
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.safety.function import Distance, Separation

_FARTHEST = 1e3
"""[m]"""
_HALVINGS = 60


class KeptDistance(NamedTuple):
    """The distance that two agents keep at rest."""

    distance: float
    """[m]"""
    radius: float
    """The distance that is asked [m]."""
    terms: Mapping[str, float]
    """By how much each term of the margin adds to it [m]."""

    def __str__(self) -> str:
        terms = ", ".join(f"{v:.2g} by {name}" for name, v in self.terms.items() if v >= 0.005)
        return (
            f"Robots that want to pass one another stop {self.distance:.3g} m apart where "
            f"{self.radius:.3g} m is asked: {terms}. phalanx explain says at any sample what holds "
            "an agent back, and which change would free it."
        )


def kept_distances(rows: SafetyRows) -> KeptDistance | None:
    """Return the largest distance that two normal agents keep, of one pair for each two groups.

    None where h is no distance, agents know one another by radio, or no pair has an own row.
    """
    swarm, function = rows.swarm, rows.swarm.safety.safe_set_function
    pairwise = swarm.safety.pairwise and not swarm.by_radio
    if not (pairwise and isinstance(function, Distance | Separation)):
        return None
    distances = [_kept(rows, i, l, function.radius) for i, l in _normal_pairs(rows)]
    return max((k for k in distances if k), key=lambda k: k.distance, default=None)


def _normal_pairs(rows: SafetyRows) -> Iterator[tuple[int, int]]:
    """Yield a pair of normal agents of each two groups, in both orders."""
    ends = [agents for agents in rows.swarm.ends if set(agents) <= set(rows.swarm.normal)]
    for n, (first, last) in enumerate(ends):
        if first != last:
            yield first, last
        for other, _ in ends[:n]:
            yield first, other
            yield other, first


def _kept(rows: SafetyRows, i: int, other: int, radius: float) -> KeptDistance | None:
    """The distance in the direction, along an axis or between two, in which it is largest."""
    part = RowPart.HALF if rows.swarm.sharing else RowPart.WHOLE
    evaluate, directions = PairRowTerms(rows, i, other, part), _directions(rows, other)
    distances = [_in_direction(evaluate, direction, radius) for direction in directions]
    return max((k for k in distances if k), key=lambda k: k.distance, default=None)


def _in_direction(evaluate: PairRowTerms, direction: Array, radius: float) -> KeptDistance | None:
    """Bisect for the distance at which the row is 0; None if it is not even far away."""

    def at(distance: float) -> Array:
        return distance * direction

    if not added(evaluate(at(_FARTHEST)).terms.values()) <= 0.0:
        return None
    near, far = radius, _FARTHEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (near + far)
        holds = added(evaluate(at(middle)).terms.values()) <= 0.0
        near, far = (near, middle) if holds else (middle, far)
    row = evaluate(at(far))
    margins = {name: value for name, value in row.terms.items() if name != ALLOWANCE}
    more = (far - radius) / max(added(margins.values()), 1e-300)
    terms = {name.removeprefix("margin: "): value * more for name, value in margins.items()}
    return KeptDistance(far, radius, terms)


def _directions(rows: SafetyRows, other: int) -> list[Array]:
    """Return stacked states at rest in which one agent is 1 m from all others, shapes (n̄,)."""
    swarm = rows.swarm
    dynamics = swarm.members[other].dynamics
    x = ca.SX.sym("x", len(dynamics.states))
    point = dynamics.position(x)
    moves = ca.substitute(ca.jacobian(point, x), x, ca.DM.zeros(*x.shape))
    ways = np.linalg.pinv(np.array(ca.DM(moves))).T
    states = [*ways, (ways[0] + ways[1]) / np.sqrt(2.0)]
    stacked = np.zeros((len(states), swarm.pairs.states))
    stacked[:, swarm.safe_set.parts[other]] = states
    return list(stacked)
