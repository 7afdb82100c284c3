"""A proven margin: a bound on the growth of a row until its agent samples again.

From a sampled state x^k the states that the swarm can reach within τ lie in a box, for any inputs
in U_l and disturbances within their bounds (a Picard enclosure). Interval arithmetic bounds the
rate of the row, and L_φ ψ_{q-1}, over that box. Unlike Eq. (mainetadef) it needs no compact S, no
Lipschitz constants and no workspace: the bound is computed at each sample.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from phalanx.theory.expressions.extension import continuous, extend
from phalanx.theory.margins.enclosure import enclose_all, scalars, within
from phalanx.theory.margins.margin import PairRow, RowPart
from phalanx.theory.models.polytope import ACTUATION
from phalanx.theory.safety.chain import Chain

UNKNOWN = ca.inf
"""The margin if there is no enclosure, or if h can jump: no row holds with it."""

_INFLATIONS = (0.2, 0.1)


def local_margin(
    chain: Chain,
    i: int,
    horizon: float | ca.SX,
    bounds: Sequence[float],
    part: RowPart,
) -> ca.SX:
    """Bound on the growth of agent i's row, scalar, an expression of the sampled state.

    Args:
        chain: of one pair, its D_q included.
        i: place of the member with this row.
        horizon: τ = Γ_i + δ_i^max and the latency [s].
        bounds: φ_l^max of each member.
        part: of the condition that the row keeps.

    Raises:
        ValueError: a member's U_l depends on the state.
        UnboundedOperationError: an expression has no interval extension.
    """
    moving = enclose_all(chain.set, bounds, horizon, _INFLATIONS)
    numbers = scalars([chain.set.parameters])
    fixed, symbols, intervals = within(moving, i, numbers, numbers)

    share = part.value
    slope = ca.jacobian(_row(chain, i, fixed, part), chain.set.x)
    rates = ca.vertcat(*[e.rate + e.phi for e in moving])
    growth, disturbance = extend([slope @ rates, share * chain.disturbance], symbols, intervals)
    outside = ACTUATION * ca.sum1(ca.vertcat(*[ca.norm_1(c.T) for c in chain.actuation]))
    bound = horizon * ca.fmax(0, growth.hi) + disturbance.hi + outside
    # Comparisons are false for NaN, which max would ignore.
    proven = ca.logic_and(growth.hi < UNKNOWN, disturbance.hi < UNKNOWN)
    # Rates do not bound a row or ψ that can jump: h must be C^{1,1}, as in the paper. ψ is tested
    # too, since a derivative does not show a jump. α is class K and so continuous.
    parts = [*map(ca.vec, chain.actuation), chain.drift, *chain.psi]
    smooth = continuous(scalars(parts), symbols, intervals)
    for e in moving:
        proven = ca.logic_and(e.certain, proven)
    return ca.if_else(ca.logic_and(proven, smooth), bound, UNKNOWN)


def _row(chain: Chain, i: int, inputs: Sequence[ca.SX], part: RowPart) -> ca.SX:
    """Agent i's row without its margin, scalar; inputs: of all members."""
    row = chain.actuation[i] @ inputs[i] + part.value * (ca.sum1(chain.drift) + chain.alpha)
    if part is RowPart.WHOLE:
        for l, c in enumerate(chain.actuation):
            row += 0 if l == i else c @ inputs[l]
    return row


@dataclass(frozen=True)
class LocalMargin:
    """A bound computed at each sample, of a pair's row with any α_q.

    >>> isinstance(LocalMargin(), Margin)
    True
    """

    def at_sample(self, row: PairRow) -> ca.SX:
        return local_margin(row.chain, row.own, row.horizon, row.bounds, row.part)
