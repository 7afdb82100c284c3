"""The margin of shares: what they cost because agents compute them from different samples.

r = -T / W, with W = Σ s_l the sum of spans, is the part of its range that every agent may use, and
v_l = (c_l u_l - m_l) / s_l the part that agent l does use. A share asks v_l <= r at agent l's own
sample; the joint sum at any time is J = Σ s_l (v_l - r). A held input keeps its v_l but for the
turning of c_l, so what makes J grow is that r falls. With w_r the inputs of agents that use just
their share, between their best and their worst input,

    -W r' = ∂/∂x (Σ drift + Σ c w_r + α_q) x'.

Its largest value over all x' = f + g u + φ, times the horizon, is what the joint condition keeps
back: with it v_l stays below r, to first order, until agent l samples again, whatever anybody does.
The second order and the turning of c_l are left to η.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import maximiser, minimiser
from phalanx.theory.rows.row import joint_sum, total_span
from phalanx.theory.rows.terms import Terms
from phalanx.theory.safety.chain import Chain


class ShareMargin:
    """Evaluates the margin at any sampled state: one gradient of the whole swarm's ψ_q.

    It is compiled from the whole expression of h_tot, which does not scale.
    """

    def __init__(self, chain: Chain, horizon: float, bounds: Sequence[float]) -> None:
        """Compile.

        Args:
            chain: of the composed set.
            horizon: τ = Γ_i + δ_i^max and the latency [s].
            bounds: φ_l^max of each member.
        """
        composed = chain.set
        self._horizon = horizon
        w = [ca.SX.sym(f"w_{m.name}", len(m.dynamics.inputs)) for m in composed.members]
        forced = [c @ u for c, u in zip(chain.actuation, w, strict=True)]
        last = ca.sum1(chain.drift) + chain.alpha + ca.sum1(ca.vertcat(*forced))
        if chain.relative_degree > 1:
            last += chain.disturbance  # which is part of ψ_q; of q = 1 it is in η
        slopes = ca.jacobian(last, composed.x)
        unforced, forces = ca.SX(0), []
        for member, part, bound in zip(composed.members, composed.parts, bounds, strict=True):
            x, slope = composed.x[part], slopes[:, part]
            unforced += slope @ member.dynamics.drift(x) + bound * ca.norm_2(slope)
            forces.append(slope @ member.dynamics.actuation(x))
        settled = [composed.substitute(o) for o in [unforced, *forces]]
        self._evaluate = CompiledFunction([composed.x, ca.vertcat(*w)], settled)

    def __call__(self, x: Array, terms: Terms, sharing: Sequence[int]) -> float:
        """What the joint condition keeps back for its shares.

        Args:
            x: stacked sampled state, shape (n̄,).
            terms: at x. Where some U_l depends on the state it counts as it is there.
            sharing: normal agents that keep their share.
        """
        unforced, *forces = self._evaluate(x, self._just_shared(terms, sharing))
        growth = float(unforced[0])
        for l, force in enumerate(forces):
            growth += float(dot(terms.polytopes[l].corners, force).max())
        return max(0.0, self._horizon * growth)

    @staticmethod
    def _just_shared(terms: Terms, sharing: Sequence[int]) -> Array:
        """w_r, stacked: r of the range of those that share, everybody else at the worst."""
        used = min(max(-joint_sum(terms, sharing) / total_span(terms, sharing), 0.0), 1.0)
        inputs = []
        for l in range(len(terms.c)):
            c, corners = terms.c[l], terms.polytopes[l].corners
            worst = maximiser(c, corners)
            if l in sharing:
                worst = worst + (1.0 - used) * (minimiser(c, corners) - worst)
            inputs.append(worst)
        return np.concatenate(inputs)
