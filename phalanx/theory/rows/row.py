"""Agent i's row aᵀu_i <= bound: its part in keeping ψ_q^d + η <= 0.

Each information model answers one question: what may agent i assume of the other normal
agents' inputs? Adversaries count at their worst, γ_j^max, in every model.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.exact import added, dot
from phalanx.theory.rows.terms import Terms

Array = NDArray[np.float64]


class Row(NamedTuple):
    """aᵀu <= bound."""

    a: Array
    """L_{g_i} ψ_{q-1}^{x_i}, shape (m_i,)."""
    bound: float


class Rows(NamedTuple):
    """a u <= bound, one row for each pair."""

    a: Array
    """shape (r, m_i)"""
    bound: Array
    """shape (r,)"""


def paper_row(terms: Terms, i: int, received: Mapping[int, Array]) -> Row:
    """The constraint of (QPdistributed) and (psiQPdistributed), as printed.

    a = L_g ψ^{x_i} and bound = -(Σ_l drift_l + Σ_{l in N, l≠i} c_l û_l + Σ_{j in A} max c_j u
    + α_q(ψ_{q-1}) + η). Sound only while û_l is what l applies.

    Args:
        terms: at agent i's sampled state.
        i: the agent.
        received: û_l, shape (m_l,), of normal agents; whoever is absent counts at γ_l^max.
    """
    others = terms.unforced + terms.margin
    for l, most in enumerate(terms.most.tolist()):
        if l in received:
            others += float(dot(terms.c[l], received[l]))
        elif l != i:
            others += most
    return Row(terms.c[i], -others)


def split_row(terms: Terms, i: int, normal: Sequence[int]) -> Row:
    """Agent i's share of the joint condition; needs nothing from the others.

    With m_l = min over U_l of c_l u and T = Σ drift + Σ_N m_l + Σ_A max c_j u + α_q + η, agent i
    keeps c_i u_i <= m_i - T / |N|. Summed over N this is the condition of Eq. (KNx), and it is
    feasible whenever that is: when T <= 0. Equal shares, not shares by authority, because agents
    compute them from different samples: what does not vary with the state does not go stale.
    """
    return Row(terms.c[i], float(terms.least[i]) - joint_sum(terms, normal) / len(normal))


def joint_sum(terms: Terms, helping: Sequence[int]) -> float:
    """T = Σ drift + α_q + η + Σ_l min or max over U_l of c_l u: the joint condition is T <= 0.

    With all normal agents helping it is the condition of Eq. (asyncminmaxcondition).

    Args:
        terms: at a state.
        helping: agents that count at their best, γ_l^min; all others count at γ_l^max.
    """
    least, most = terms.least.tolist(), terms.most.tolist()
    extremes = added(least[l] if l in helping else most[l] for l in range(len(least)))
    return terms.unforced + terms.margin + extremes
