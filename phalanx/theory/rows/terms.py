"""The numbers of one sampled state that a row is made of: the chain, compiled and evaluated."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import casadi as ca

from phalanx.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.polytope import Polytope, constant_polytope, extremes, polytope
from phalanx.theory.rows.unseen import with_unseen_far
from phalanx.theory.safety.chain import Chain


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


class EvaluatedTerms(NamedTuple):
    """Terms that are numbers already."""

    psi: Array
    unforced: float
    c: Mapping[int, Array]
    least: Mapping[int, float]
    most: Mapping[int, float]
    polytopes: Mapping[int, Polytope]
    positions: Mapping[int, Array]
    margin: float


class TermsAt(Protocol):
    """Terms of h_tot as one agent has them."""

    def __call__(self, x: Array, seen: Sequence[int] | None = None) -> Terms:
        """At a stacked state x, shape (n̄,), of which only the members seen are known.

        seen: in ascending order; None for all.
        """


class TermsFunction:
    """Compiles a chain once; evaluates it at any sampled state in a few microseconds.

    Where U_l is constant its vertices are known beforehand, and the linear programs of
    Eq. (LPvminmax) become part of the compiled expression.
    """

    def __init__(
        self, chain: Chain, active: ca.SX | None = None, margin: ca.SX | float = 0.0
    ) -> None:
        """Compile.

        Args:
            chain: of the composed set.
            active: which pairs count at a state, as ComposedSet.substitute has it.
            margin: of the row that the terms are for, scalar.

        Raises:
            EmptyPolytopeError: a constant input polytope is empty or unbounded.
        """
        composed = chain.set
        self._parts = composed.parts
        symbolic = [
            member.dynamics.input_polytope(composed.x[part])
            for member, part in zip(composed.members, composed.parts, strict=True)
        ]
        constant = [constant_polytope(A, b) for A, b in symbolic]
        self._varying = [l for l, known in enumerate(constant) if known is None]
        self._polytopes = {l: known for l, known in enumerate(constant) if known is not None}
        values = [
            ca.DM(known.corners) @ row.T if known else ca.SX.zeros(1)
            for known, row in zip(constant, chain.actuation, strict=True)
        ]
        outputs = [
            ca.vertcat(*chain.psi),
            ca.vertcat(ca.sum1(chain.drift) + chain.alpha, margin),
            ca.vertcat(*[ca.mmin(v) for v in values]),
            ca.vertcat(*[ca.mmax(v) for v in values]),
            *chain.actuation,
            *composed.positions,
            *[expression for l in self._varying for expression in symbolic[l]],
        ]
        settled = [composed.substitute(o, active) for o in outputs]
        self._evaluate = CompiledFunction([composed.x], settled)

    def __call__(self, x: Array, seen: Sequence[int] | None = None) -> EvaluatedTerms:
        """Evaluate at a stacked state x, shape (n̄,), of which only the members seen are known."""
        psi, (unforced, margin), least, most, *rest = self._evaluate(
            with_unseen_far(x, self._parts, seen)
        )
        n = len(least)
        c, positions, varying = rest[:n], rest[n : 2 * n], rest[2 * n :]
        polytopes = dict(self._polytopes)
        for l, A, b in zip(self._varying, varying[::2], varying[1::2], strict=True):
            polytopes[l] = polytope(A.reshape(len(b), -1), b)
            least[l], most[l] = extremes(c[l], polytopes[l].corners)
        known = range(n) if seen is None else seen
        return EvaluatedTerms(
            psi=psi,
            unforced=float(unforced),
            c={l: c[l] for l in known},
            least={l: float(least[l]) for l in known},
            most={l: float(most[l]) for l in known},
            polytopes=polytopes,
            positions={l: positions[l] for l in known},
            margin=float(margin),
        )
