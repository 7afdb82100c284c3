"""How long no pair of an agent can become unsafe, whatever anybody does, if it holds its input.

From the true state and the input that is applied alone: who made the input, and from what, has no
part in it. A pair's certificate is the best of three bounds, each over several horizons: of h over
the box that can be reached, of h integrated (q > 1), and of ψ_{q-1} integrated. Every number in it
is rounded outwards.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.extension import extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, point
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import (
    Enclosure,
    admissible_inputs,
    enclose,
    fastest,
    moved,
    scalars,
)
from phalanx.theory.margins.integrated import INFLATIONS, growth, keeps_chain, time_until_zero
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import ComposedSet, Member

MULTIPLES = (8.0, 4.0, 2.0, 1.0 + 1e-9)
"""The horizons that are tried, in τ: over a longer one the box is larger. The last is above τ, for
sums of sampling periods round, and a certificate that is over before the next input is none."""


DEFECT = 1e-4
"""How far the plant's motion may be off the equation [1/s]: it counts as disturbance."""


@dataclass(frozen=True)
class PairCertificate:
    """Of pairs of one kind, for agent i in them."""

    horizons: tuple[float, ...]
    """What is tried, the longest first [s]."""
    proven: MappedFunction | None
    """(x and the obstacle's numbers, u_i, T) -> how much of [0, T] is proven safe [s]; None if
    nothing ever is."""
    refused: str = ""
    """What could not be bounded, in words."""

    def times(self, pairs: Array, u: Array) -> Array:
        """How long h <= 0 is proven from now on [s], shape (r,); 0 if not at all.

        Args:
            pairs: each one's state, its members' in order, and numbers of its obstacle; (r, n).
            u: the input that agent i holds, of each pair or of all, shape (r, m_i) or (m_i,).
        """
        best, u = np.zeros(len(pairs)), np.broadcast_to(u, (len(pairs), u.shape[-1]))
        if self.proven is None:
            return best
        for horizon in self.horizons:
            open_ = np.flatnonzero(best < horizon)
            if not len(open_):
                break
            rows = np.column_stack([pairs[open_], u[open_], np.full(len(open_), horizon)])
            places = np.arange(rows.size).reshape(rows.shape)
            best[open_] = np.maximum(best[open_], self.proven(rows.ravel(), places)[:, 0])
        return best


@outwards()
def pair_certificate(
    pair: ComposedSet,
    own: int,
    alphas: Sequence[ClassK],
    bounds: Sequence[float],
    longest: float,
) -> PairCertificate:
    """Compile one pair's certificate.

    Args:
        pair: one pair alone; its obstacle may be one of symbols.
        own: agent i's place in it.
        alphas: α_1 ... α_q; the last has no part in it.
        bounds: φ_l^max of each member.
        longest: τ = Γ_i + δ_i^max and the latency [s].
    """
    horizons = tuple(multiple * longest for multiple in MULTIPLES)
    horizon = ca.SX.sym("T")
    try:
        moving = [
            enclose(
                member,
                pair.x[part],
                None if l == own else admissible_inputs(member),
                bounds[l],
                horizon,
                INFLATIONS,
            )
            for l, (member, part) in enumerate(zip(pair.members, pair.parts, strict=True))
        ]
    except ValueError as error:
        return PairCertificate(horizons, None, str(error))
    chain = build_chain(pair, alphas, None, bounds)

    def reached() -> ca.SX:
        return ca.if_else(_highest(pair, moving) <= 0, horizon, 0)

    def integrated(value: ca.SX) -> ca.SX:
        return time_until_zero(growth(value, pair, own, moving, bounds), horizon)

    def kept() -> ca.SX:
        return ca.if_else(keeps_chain(chain, alphas, moving), integrated(chain.psi[-1]), 0)

    kinds: list[Callable[[], ca.SX]] = [reached, lambda: integrated(pair.h_tot)]
    kinds += [kept] if chain.relative_degree > 1 else []
    times, refused = [], []
    for kind in kinds:
        try:
            times.append(kind())
        except UnboundedOperationError as error:
            refused.append(str(error))
    if not times:
        return PairCertificate(horizons, None, "; ".join(refused))
    row = [pair.x, pair.parameters, moving[own].u, horizon]
    proven = MappedFunction(row, [ca.mmax(ca.vertcat(*times))])
    return PairCertificate(horizons, proven, "; ".join(refused))


@outwards()
def highest_within(
    pair: ComposedSet, bounds: Sequence[float], horizon: float
) -> MappedFunction | None:
    """(x, parameters) -> the highest that h can be within the horizon; None if unknown."""
    try:
        reach = [
            reach_within(member, pair.x[part], bound, horizon)
            for member, part, bound in zip(pair.members, pair.parts, bounds, strict=True)
        ]
        return MappedFunction([pair.x, pair.parameters], [_highest(pair, reach)])
    except ValueError:  # a pair that is refused
        return None


class Reach(NamedTuple):
    """Where one agent's state can be within a horizon."""

    x: ca.SX
    states: list[Interval]
    certain: ca.SX
    """1 if the state is proven to stay there."""


def reach_within(member: Member, x: ca.SX, bound: float, horizon: float) -> Reach:
    """Where a member's state can be within a horizon [s], whatever it does.

    Raises ValueError if that has no bound.
    """
    inputs = admissible_inputs(member)
    rates = fastest(member, inputs, bound)
    if rates is not None:
        return Reach(x, moved(x, rates, horizon), ca.SX(1))
    e = enclose(member, x, inputs, bound, horizon, INFLATIONS)
    return Reach(x, e.states, e.certain)


def _highest(pair: ComposedSet, reach: Sequence[Reach | Enclosure]) -> ca.SX:
    """sup of h over the boxes, which needs no continuity; inf where it is unknown."""
    numbers = scalars([pair.parameters])
    boxes = [*[interval for r in reach for interval in r.states], *map(point, numbers)]
    (found,) = extend([pair.h_tot], scalars([r.x for r in reach]) + numbers, boxes)
    certain = ca.SX(1)
    for r in reach:
        certain = ca.logic_and(certain, r.certain)
    return ca.if_else(certain, found.hi, ca.inf)
