"""The numbers of one sampled state that a row is made of: the chain, compiled and evaluated."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.polytope import Polytope, constant_polytope, extremes, polytope
from phalanx.theory.rows.unseen import with_unseen_far
from phalanx.theory.safety.chain import Chain

Array = NDArray[np.float64]

_NOTHING = np.zeros((0, 0))
_EVALUATED_EACH_TIME = Polytope(_NOTHING, _NOTHING, _NOTHING, None, 0.0)


class Terms(NamedTuple):
    """ψ_q^d at a sampled state, split by member: Σ drift_l + Σ c_l u_l + α_q(ψ_{q-1})."""

    psi: Array
    """ψ_0^d ... ψ_{q-1}^d, shape (q,)."""
    unforced: float
    """Σ_l L_{f_l} ψ_{q-1}^{x_l} + α_q(ψ_{q-1}^d): what no input changes."""
    c: list[Array]
    """L_{g_l} ψ_{q-1}^{x_l} by member, shapes (m_l,)."""
    least: Array
    """min over U_l of c_l u, shape (N,): γ_l^min without its drift, Eq. (vLPs)."""
    most: Array
    """max over U_l of c_l u, shape (N,): γ_l^max without its drift."""
    polytopes: list[Polytope]
    """U_l by member."""
    positions: Mapping[int, Array]
    """Output positions of the members that are seen [m]."""
    margin: float = 0.0
    """η with all that is added to it at this state, as margins.margin.Margin sums it."""


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
        self._polytopes = [known or _EVALUATED_EACH_TIME for known in constant]
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

    def __call__(self, x: Array, seen: Sequence[int] | None = None) -> Terms:
        """Evaluate at a stacked state x, shape (n̄,), of which only the members seen are known."""
        psi, (unforced, margin), least, most, *rest = self._evaluate(
            with_unseen_far(x, self._parts, seen)
        )
        members = len(self._polytopes)
        c, everywhere, varying = rest[:members], rest[members : 2 * members], rest[2 * members :]
        positions = {l: everywhere[l] for l in (range(members) if seen is None else seen)}
        polytopes = self._polytopes
        if varying:
            polytopes = list(polytopes)
            for l, A, b in zip(self._varying, varying[::2], varying[1::2], strict=True):
                polytopes[l] = polytope(A.reshape(len(b), -1), b)
                least[l], most[l] = extremes(c[l], polytopes[l].corners)
        return Terms(psi, float(unforced), c, least, most, polytopes, positions, float(margin))
