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

UNKNOWN = ca.inf
"""The margin if there is no enclosure, or if h can jump: no row holds with it."""

_INFLATIONS = (0.2, 0.1)


@dataclass(frozen=True)
class LocalMargin:
    """A bound computed at each sample, of a pair's row with any α_q.

    >>> isinstance(LocalMargin(), Margin)
    True
    """

    def at_sample(self, row: PairRow) -> ca.SX:
        """The bound on the row's growth; inf where none is proven.

        Raises:
            ValueError: a member's U_l depends on the state.
            UnboundedOperationError: an expression has no interval extension.
        """
        chain = row.chain
        moving = enclose_all(chain.set, row.bounds, row.horizon, _INFLATIONS)
        numbers = scalars([chain.set.parameters])
        fixed, symbols, intervals = within(moving, row.own, numbers, numbers)

        slope = ca.jacobian(_condition(row, fixed), chain.set.x)
        rates = ca.vertcat(*[e.rate + e.phi for e in moving])
        growth, disturbance = extend(
            [slope @ rates, row.share * chain.disturbance], symbols, intervals
        )
        outside = ACTUATION * ca.sum1(ca.vertcat(*[ca.norm_1(c.T) for c in chain.actuation]))
        bound = row.horizon * ca.fmax(0, growth.hi) + disturbance.hi + outside
        # Comparisons are false for NaN, which max would ignore.
        proven = ca.logic_and(growth.hi < UNKNOWN, disturbance.hi < UNKNOWN)
        # Rates do not bound a row or ψ that can jump: h must be C^{1,1}, as in the paper. ψ is
        # tested too, since a derivative does not show a jump. α is class K and so continuous.
        parts = [*map(ca.vec, chain.actuation), chain.drift, *chain.psi]
        smooth = continuous(scalars(parts), symbols, intervals)
        for e in moving:
            proven = ca.logic_and(e.certain, proven)
        return ca.if_else(ca.logic_and(proven, smooth), bound, UNKNOWN)


def _condition(row: PairRow, inputs: Sequence[ca.SX]) -> ca.SX:
    """The row without its margin, scalar; inputs: of all members."""
    chain, own = row.chain, row.own
    condition = chain.actuation[own] @ inputs[own]
    condition += row.share * (ca.sum1(chain.drift) + chain.alpha)
    if row.part is RowPart.WHOLE:
        for l, c in enumerate(chain.actuation):
            condition += 0 if l == own else c @ inputs[l]
    return condition
