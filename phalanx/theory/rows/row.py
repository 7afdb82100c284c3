"""Agent i's row aᵀu_i <= bound, its part in keeping ψ_q^d + η <= 0, and the terms it is made of.

The information models differ in the inputs that they assume of other normal agents. Adversaries
count at their worst, γ_j^max, in every model.
"""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from msgspec import Struct

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import added, inner
from phalanx.theory.models.polytope import Polytope


class Terms(Protocol):
    """ψ_q^d at a sampled state, split by member: Σ drift_l + Σ c_l u_l + α_q(ψ_{q-1}).

    Members go by their index in the swarm.
    """

    @property
    def psi(self) -> Array:
        """ψ_0^d ... ψ_{q-1}^d, shape (q,)."""

    @property
    def unforced(self) -> float:
        """Σ_l L_{f_l} ψ_{q-1}^{x_l} + α_q(ψ_{q-1}^d), the part without inputs."""

    @property
    def c(self) -> Mapping[int, Array]:
        """L_{g_l} ψ_{q-1}^{x_l} of each member that is seen, shapes (m_l,)."""

    @property
    def least(self) -> Mapping[int, float]:
        """min over U_l of c_l u, likewise: γ_l^min without its drift, Eq. (vLPs)."""

    @property
    def most(self) -> Mapping[int, float]:
        """max over U_l of c_l u, likewise: γ_l^max without its drift."""

    @property
    def polytopes(self) -> Mapping[int, Polytope]:
        """U_l, likewise."""

    @property
    def positions(self) -> Mapping[int, Array]:
        """Output positions, likewise [m]."""

    @property
    def margin(self) -> float:
        """η and the part of the margin that depends on the state, as margins.margin sums them."""


class Row(Struct, frozen=True):
    """aᵀu <= bound."""

    a: Array
    """L_{g_i} ψ_{q-1}^{x_i}, shape (m_i,)."""
    bound: float


class Rows(Struct, frozen=True):
    """a u <= bound, one row for each pair.

    >>> Rows(a=np.array([[1.0, 0.0]]), bound=np.array([0.5])).bound
    array([0.5])
    """

    a: Array
    """shape (r, m_i)"""
    bound: Array
    """shape (r,)"""
    margin: Array | None = None
    """The part of each bound that is margin, shape (r,), if it is known."""
    others: tuple[int, ...] = ()
    """The other member of each row's pair, or N + k for obstacle k; empty if unknown."""


def paper_row(terms: Terms, i: int, received: Mapping[int, Sequence[float]]) -> Row:
    """The constraint of (QPdistributed) and (psiQPdistributed), as printed.

    a = L_g ψ^{x_i} and bound = -(Σ_l drift_l + Σ_{l in N, l≠i} c_l û_l + Σ_{j in A} max c_j u
    + α_q(ψ_{q-1}) + η). Sound only while û_l is what l applies.

    Args:
        terms: at agent i's sampled state.
        i: the agent.
        received: û_l, shape (m_l,), of normal agents; those without count at γ_l^max.
    """
    others, c = terms.unforced + terms.margin, terms.c
    for l, most in terms.most.items():
        if l in received:
            others += inner(c[l].tolist(), received[l])
        elif l != i:
            others += most
    return Row(c[i], -others)


_FLOOR = 0.01
"""Added to each span, so that an agent without authority has a share too."""


def split_row(terms: Terms, i: int, normal: Sequence[int]) -> Row:
    """Agent i's share of the joint condition, without inputs of the others.

    With m_l = min over U_l of c_l u and T = Σ drift + Σ_N m_l + Σ_A max c_j u + α_q + η, agent i
    keeps c_i u_i <= m_i + ω_i (-T). Summed over N, with Σ ω_i = 1, this is the condition of
    Eq. (KNx). As ω_i > 0 and the least c_i u_i is m_i, the row has a solution if and only if
    T <= 0: every agent's row has one whenever the joint condition has.

    Args:
        terms: at agent i's sampled state.
        i: the agent.
        normal: those that keep a share.
    """
    index = list(normal).index(i)
    share = shares(terms, normal)[index] * -joint_sum(terms, normal)
    return Row(terms.c[i], terms.least[i] + float(share))


def shares(terms: Terms, normal: Sequence[int]) -> Array:
    """ω_l of each normal agent, positive, of sum 1: in proportion to its span.

    The span s_l = max c_l u - min c_l u is the largest effect of its input on ψ_q; so all may use
    the same part of theirs. Equal shares would give leeway to agents that cannot use it, and take
    it from those in a conflict.
    """
    spans = [terms.most[l] - terms.least[l] + _FLOOR for l in normal]
    return np.array(spans) / added(spans)


def joint_sum(terms: Terms, helping: Sequence[int]) -> float:
    """T = Σ drift + α_q + η + Σ_l min or max over U_l of c_l u: the joint condition is T <= 0.

    With all normal agents helping it is the condition of Eq. (asyncminmaxcondition).

    Args:
        terms: at a state.
        helping: agents that count at γ_l^min; all others count at γ_l^max.
    """
    least, most = terms.least, terms.most
    extremes = added([least[l] if l in helping else most[l] for l in most])
    return terms.unforced + terms.margin + extremes
