"""The margin of shares, needed because agents compute them from different samples.

r = -T / W, with W = Σ s_l the sum of spans, is the part of its range that every agent may use, and
v_l = (c_l u_l - m_l) / s_l the part that agent l does use. A share requires v_l <= r at agent l's
own sample; the joint sum at any time is J = Σ s_l (v_l - r). A held input keeps its v_l except for
changes of c_l, so J grows because r falls. With w_r the inputs of agents that use exactly their
share, between their best and their worst input,

    -W r' = ∂/∂x (Σ drift + Σ c w_r + α_q) x'.

Its largest value over all x' = f + g u + φ, times the horizon, is added to the joint condition:
then v_l stays below r, to first order, until agent l samples again, whatever the others do. The
second order and changes of c_l are left to η.
"""

from collections.abc import Sequence

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import BoundFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.models.polytope import maximiser, minimiser
from phalanx.theory.rows.by_derivatives import TermsByDerivatives
from phalanx.theory.rows.row import Terms, joint_sum, total_span


class ShareMargin:
    """The margin at any sampled state, from one gradient of the swarm's ψ_q."""

    def __init__(self, by_derivatives: TermsByDerivatives, horizon: float) -> None:
        """horizon: τ = Γ_i + δ_i^max and the latency [s]."""
        pairs, members = by_derivatives.pairs, by_derivatives.members
        kinds = list(members.by_kind(range(len(pairs.members))).items())
        function, places = by_derivatives.rates(kinds, pairs.choose(pairs.every))
        numbers = [by_derivatives.numbers.copy(), *[p.ravel().astype(np.float64) for p in places]]
        sizes = [(members.kinds[k].inputs, own) for k, own in kinds]
        self._inputs, count = by_derivatives.layout(sizes, 0)
        self._w = np.zeros(count)
        self._bound = BoundFunction(function, [*numbers, self._w])
        self._x, self._found = numbers[0][: pairs.states], self._bound.outputs[0]
        self._horizon = horizon

    def __call__(self, x: Array, terms: Terms, sharing: Sequence[int]) -> float:
        """The amount by which the joint condition is tightened.

        Args:
            x: stacked sampled state, shape (n̄,).
            terms: at x. A U_l that depends on the state counts as it is at x.
            sharing: normal agents that keep their share.
        """
        used = min(max(-joint_sum(terms, sharing) / total_span(terms, sharing), 0.0), 1.0)
        for l, own in self._inputs.items():
            self._w[own] = _just_shared(terms, l, used if l in sharing else 1.0)
        self._x[:] = x
        self._bound.call()
        growth, forces = float(self._found[0]), self._found[1:]
        for l, own in sorted(self._inputs.items()):
            growth += float(dot(terms.polytopes[l].corners, forces[own]).max())
        return max(self._horizon * growth, 0.0)  # NaN stays


def _just_shared(terms: Terms, l: int, used: float) -> Array:
    """w_r of agent l if it uses a part of its range, from its best input to its worst."""
    c, corners = terms.c[l], terms.polytopes[l].corners
    worst = maximiser(c, corners)
    return worst + (1.0 - used) * (minimiser(c, corners) - worst)
