"""A pair's certificate: the time for which it stays safe if an agent holds its input.

It holds for all inputs of the other agents, and is computed from the true state and the applied
input alone. It is the best of three bounds, each over several horizons: of h over the reachable
box, of h integrated (q > 1), and of ψ_{q-1} integrated. Every number is rounded outwards.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.extension import extend
from phalanx.theory.expressions.interval import Interval, UnboundedOperationError, point
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import (
    Enclosure,
    admissible_inputs,
    enclose,
    enclose_all,
    fastest,
    moved,
    scalars,
)
from phalanx.theory.margins.integrated import INFLATIONS, growth, keeps_chain, time_until_zero
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import ComposedSet, Member

MULTIPLES = (8.0, 4.0, 2.0, 1.0 + 1e-9)
"""Horizons to try, in τ: a longer one has a larger box. The last is above τ, since sums of sampling
periods are rounded, and a certificate must last until the next input."""


@dataclass(frozen=True)
class PairCertificate:
    """Compiled certificate of pairs of one kind, for agent i in them."""

    horizons: tuple[float, ...]
    """Horizons to try, the longest first [s]."""
    proven: MappedFunction | None
    """(x and the obstacle's numbers, u_i, T) -> the part of [0, T] that is proven safe [s]; None if
    no bound exists."""
    refused: str = ""
    """Reasons for missing bounds."""

    def times(self, pairs: Array, u: Array) -> Array:
        """Return the times for which h <= 0 is proven from now on [s], shape (r,); 0 if not proven.

        Args:
            pairs: states of each pair's members in order, and its obstacle's numbers; (r, n).
            u: the input that agent i holds, for each pair or for all, shape (r, m_i) or (m_i,).
        """
        best = np.zeros(len(pairs))
        if self.proven is None:
            return best
        rows = np.empty((len(pairs), self.proven.inputs))
        rows[:, : pairs.shape[1]], rows[:, pairs.shape[1] : -1] = pairs, u
        for horizon in self.horizons:
            open_ = np.flatnonzero(best < horizon)
            if not len(open_):
                break
            rows[:, -1] = horizon
            best[open_] = np.maximum(best[open_], self.proven.rows(rows[open_])[:, 0])
        return best


@outwards()
def pair_certificate(
    pair: ComposedSet,
    side: int,
    alphas: Sequence[ClassK],
    bounds: Sequence[float],
    longest: float,
) -> PairCertificate:
    """Compile one pair's certificate.

    Args:
        pair: one pair alone; its obstacle's numbers may be symbols.
        side: agent i's in it, 0 or 1.
        alphas: α_1 ... α_q; the last is not used.
        bounds: φ_l^max of each member.
        longest: τ = Γ_i + δ_i^max and the latency [s].
    """
    horizons = tuple(multiple * longest for multiple in MULTIPLES)
    horizon = ca.SX.sym("T")
    try:
        moving = enclose_all(pair, bounds, horizon, INFLATIONS, held=side)
    except ValueError as error:
        return PairCertificate(horizons, None, str(error))
    chain = build_chain(pair, alphas, None, bounds)

    def reached() -> ca.SX:
        return ca.if_else(_highest(pair, moving) <= 0, horizon, 0)

    def integrated(value: ca.SX) -> ca.SX:
        return time_until_zero(growth(value, pair, side, moving, bounds), horizon)

    def integrated_chain() -> ca.SX:
        return ca.if_else(keeps_chain(chain, alphas, moving), integrated(chain.psi[-1]), 0)

    kinds: list[Callable[[], ca.SX]] = [reached, lambda: integrated(pair.h_tot)]
    kinds += [integrated_chain] if chain.relative_degree > 1 else []
    times, refused = [], []
    for kind in kinds:
        try:
            times.append(kind())
        except UnboundedOperationError as error:
            refused.append(str(error))
    if not times:
        return PairCertificate(horizons, None, "; ".join(refused))
    row = [pair.x, pair.parameters, moving[side].u, horizon]
    proven = MappedFunction(row, [ca.mmax(ca.vertcat(*times))])
    return PairCertificate(horizons, proven, "; ".join(refused))


@outwards()
def least_now(pair: ComposedSet) -> ca.SX:
    """Bound h from below at the sample; -inf if there is no bound."""
    symbols = scalars([pair.x, pair.parameters])
    try:
        (h,) = extend([pair.h_tot], symbols, list(map(point, symbols)))
    except UnboundedOperationError:
        return ca.SX(-ca.inf)
    return h.lo


@outwards()
def highest_within(pair: ComposedSet, bounds: Sequence[float], horizon: float | ca.SX) -> ca.SX:
    """Bound h from above within the horizon; inf if there is no bound."""
    try:
        reach = [
            reach_within(member, pair.x[part], bound, horizon)
            for member, part, bound in zip(pair.members, pair.parts, bounds, strict=True)
        ]
        return _highest(pair, reach)
    except ValueError:  # a pair that is refused
        return ca.SX(ca.inf)


class Reach(NamedTuple):
    """Box of one agent's reachable states within a horizon."""

    x: ca.SX
    states: list[Interval]
    certain: ca.SX
    """1 if the state is proven to stay in the box."""


def reach_within(member: Member, x: ca.SX, bound: float, horizon: float | ca.SX) -> Reach:
    """Bound a member's states within a horizon [s] for all its inputs.

    Raises ValueError if there is no bound.
    """
    inputs = admissible_inputs(member)
    rates = fastest(member, inputs, bound)
    if rates is not None:
        return Reach(x, moved(x, rates, horizon), ca.SX(1))
    e = enclose(member, x, inputs, bound, horizon, INFLATIONS)
    return Reach(x, e.states, e.certain)


def _highest(pair: ComposedSet, reach: Sequence[Reach | Enclosure]) -> ca.SX:
    """Bound h over the boxes, without continuity; inf if the boxes are uncertain."""
    numbers = scalars([pair.parameters])
    boxes = [*[interval for r in reach for interval in r.states], *map(point, numbers)]
    (h,) = extend([pair.h_tot], scalars([r.x for r in reach]) + numbers, boxes)
    certain = ca.SX(1)
    for r in reach:
        certain = ca.logic_and(certain, r.certain)
    return ca.if_else(certain, h.hi, ca.inf)
