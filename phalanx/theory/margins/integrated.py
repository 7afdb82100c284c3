"""A bound on V(t) between samples, integrated over the interval: V(t) <= V_k + t (r + D) + ½ t² g.

V is ψ_{q-1}, whose rate contains the inputs, or h itself for q > 1, whose rate does not. Agent i
holds its input; all other inputs and every disturbance vary freely within their bounds. The proof
is in docs/certificate.md. As a margin of a row the same bound holds for every input that agent i
may choose.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca

from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.expressions.interval import Interval, add, point
from phalanx.theory.expressions.rounding import rounds_outwards
from phalanx.theory.margins.enclosure import (
    Enclosure,
    admissible_corners,
    enclose_all,
    scalars,
    within,
)
from phalanx.theory.margins.margin import PairRow, RowPart
from phalanx.theory.models.polytope import ACTUATION
from phalanx.theory.safety.chain import Chain, disturbance_bound, lie_derivatives
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import ComposedSet

INFLATIONS = (0.5, 0.5, 0.3, 0.1)
"""Rounds of an enclosure for horizons of some tenths of a second; the box is hardly wider."""

STEEPEST = {RowPart.WHOLE: 1.0, RowPart.HALF: math.exp(-1.0)}
"""Largest κ τ for which α_q(ψ) = κ ψ provably keeps ψ_{q-1}; halves use two agents' samples."""


class Growth(NamedTuple):
    """V(t) <= value + t (rate + disturbance) + ½ t² bend until the horizon; scalars."""

    value: ca.SX
    """V at the sample."""
    rate: ca.SX
    """r = Σ drift + c_i u_i + Σ max c_l w at the sample; contains u_i. For a half, its own part."""
    disturbance: ca.SX
    """D = sup over B of Σ_l ‖∂V/∂x_l‖ φ_l^max."""
    bend: ca.SX
    """g = max(0, sup over B of the rate of Σ drift + c_i u_i + Σ c_l w), each w a fixed input; for
    a half, the rate of ½ Σ drift + c_i u_i."""
    proven: ca.SX
    """1 if the bound is proven at this state, else 0."""


def growth(
    value: ca.SX,
    pair: ComposedSet,
    side: int,
    moving: Sequence[Enclosure],
    bounds: Sequence[float],
    part: RowPart = RowPart.WHOLE,
) -> Growth:
    """The bound's parts, as expressions of the sampled state and agent i's input.

    Args:
        value: V, an expression of the members' states.
        pair: one pair alone.
        side: agent i's, 0 or 1.
        moving: the members' enclosures; agent i's is for one held input, or for all of U_i.
        bounds: φ_l^max of each member.
        part: of V's rate that agent i's row keeps; a half bounds that part alone, not V.

    Raises:
        ValueError: another member's U depends on the state.
        UnboundedOperationError: an expression has no interval extension.
    """
    members, numbers = pair.members, scalars([pair.parameters])
    fixed, symbols, box = within(moving, side, numbers, numbers)
    gradients, drifts, actuation = lie_derivatives(pair, value)
    drift = sum(drifts, ca.SX(0))
    rate = row = part.value * drift + actuation[side] @ moving[side].u
    others = [l for l in range(len(members)) if l != side]
    for l in others if part is RowPart.WHOLE else ():
        row += actuation[l] @ fixed[l]
        rate += ca.mmax(ca.DM(admissible_corners(members[l])) @ actuation[l].T)
    slopes = [ca.jacobian(row, e.x) for e in moving]
    change = disturbance_bound(slopes, bounds)
    for slope, e in zip(slopes, moving, strict=True):
        change += slope @ e.rate

    steepness = disturbance_bound(gradients, [1.0] * len(members))
    bounded = [change, disturbance_bound(gradients, bounds), steepness]
    bend, disturbance, steep = extend(bounded, symbols, box)
    parts = [value, *[d.T for d in gradients], drift, *[c.T for c in actuation]]
    proven = continuous(scalars(parts), symbols, box)
    for e in moving:
        proven = ca.logic_and(proven, e.certain)
    sampled = scalars([*[e.x for e in moving], moving[side].u])
    value, rate = _at_most([value, rate], [*sampled, *numbers])
    # Comparisons are false for NaN, which max would ignore.
    for number in (value, disturbance.hi, bend.hi, steep.hi):
        proven = ca.logic_and(proven, number < ca.inf)
    return Growth(value, rate, disturbance.hi, ca.fmax(0, bend.hi), proven)


def _at_most(values: Sequence[ca.SX], symbols: Sequence[ca.SX]) -> list[ca.SX]:
    """Expressions of the sample; their upper ends if intervals are rounded outwards."""
    if not rounds_outwards():
        return list(values)
    return [bound.hi for bound in extend(values, symbols, list(map(point, symbols)))]


@dataclass(frozen=True)
class IntegratedMargin:
    """A smaller bound computed at each sample, of a pair's row with a linear α_q.

    η is D + ½ τ g, or ½ D + τ g of a half. With α_q(ψ) = κ ψ and κ τ at most STEEPEST it keeps
    ψ_{q-1} <= 0.

    >>> isinstance(IntegratedMargin(), Margin)
    True
    """

    def at_sample(self, row: PairRow) -> ca.SX:
        """η of the row; inf if there is no bound.

        Raises:
            ValueError: a member's U_l depends on the state.
            UnboundedOperationError: an expression has no interval extension.
        """
        chain = row.chain
        moving = enclose_all(chain.set, row.bounds, row.horizon, INFLATIONS)
        bound = growth(chain.psi[-1], chain.set, row.own, moving, row.bounds, row.part)
        # A half is compared at each instant, a whole row's excess averages out over the interval.
        lasting = 0.5 * row.horizon if row.part is RowPart.WHOLE else row.horizon
        outside = ACTUATION * ca.sum1(ca.vertcat(*[ca.norm_1(c.T) for c in chain.actuation]))
        margin = row.share * bound.disturbance + lasting * bound.bend + outside
        return ca.if_else(bound.proven, margin, ca.inf)


def time_until_zero(bound: Growth, horizon: float | ca.SX) -> ca.SX:
    """Time for which the bound stays at or below zero, at most the horizon [s]; 0 if unknown.

    The bound is convex in t: from V_k <= 0 it crosses zero once. The root is exact to ten float64,
    since nothing in it cancels, if the square of the speed does not underflow; rounded outwards the
    time is a share of 1e-13 shorter, and the speed higher.
    """
    exact = not rounds_outwards()
    speed = add(point(bound.rate), point(bound.disturbance)).hi + (0.0 if exact else 1e-140)
    root = ca.sqrt(ca.fmax(0, speed * speed - 2 * bound.bend * bound.value))
    # Two forms of the root; the one used does not cancel.
    rising = -2 * bound.value / (speed + root)
    falling = ca.if_else(bound.bend > 0, (root - speed) / bound.bend, ca.inf)
    crossing = (1.0 if exact else 1.0 - 1e-13) * ca.if_else(speed > 0, rising, falling)
    proven = ca.logic_and(bound.proven, ca.logic_and(bound.value <= 0, bound.rate < ca.inf))
    return ca.if_else(proven, ca.fmin(horizon, crossing), 0)


def keeps_chain(chain: Chain, alphas: Sequence[ClassK], moving: Sequence[Enclosure]) -> ca.SX:
    """1 if ψ_{q-1} <= 0 until the horizon keeps h <= 0 with it, else 0.

    It does if ψ_0 ... ψ_{q-2} start at or below zero and no α_k is negative where ψ_{k-1} > 0 could
    be reached. Every ψ_k must have D_k in it.

    Args:
        chain: of the pair, with D_1 in place of ξ and with bounds.
        alphas: α_1 ... α_q, as the chain was built.
        moving: the members' enclosures.

    Raises:
        UnboundedOperationError: an expression has no interval extension.
    """
    numbers = scalars([chain.set.parameters])
    symbols = scalars([e.x for e in moving]) + numbers
    starts = _at_most(chain.psi[:-1], symbols)
    box = [*[interval for e in moving for interval in e.states], *map(point, numbers)]
    holds = continuous(list(chain.psi[:-1]), symbols, box)
    for psi, start, alpha in zip(chain.psi[:-1], starts, alphas, strict=False):
        steepness = disturbance_bound([ca.jacobian(psi, e.x) for e in moving], [1.0] * len(moving))
        reach, steep = extend([psi, steepness], symbols, box)
        s = ca.SX.sym("s")
        (back,) = extend([alpha.value(s)], [s], [Interval(ca.SX(0), ca.fmax(0, reach.hi))])
        for bounded in (reach.hi < ca.inf, steep.hi < ca.inf, start <= 0, back.lo >= 0):
            holds = ca.logic_and(holds, bounded)
    return holds
