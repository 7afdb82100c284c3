"""The numbers of one sampled state that a row is made of."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from phalanx.arrays import Array
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
        """Σ_l L_{f_l} ψ_{q-1}^{x_l} + α_q(ψ_{q-1}^d): what no input changes."""

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
        """η with all that is added to it at this state, as margins.margin.Margin sums it."""


class TermsAt(Protocol):
    """Terms of h_tot as one agent has them."""

    def __call__(self, x: Array, seen: Sequence[int] | None = None) -> Terms:
        """At a stacked state x, shape (n̄,), of which only the members seen are known.

        seen: in ascending order; None for all.
        """
