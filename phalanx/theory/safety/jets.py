"""h_tot and its ψ-chain from the numbers of its pairs: truncated Taylor arithmetic of LSE.

Along the drift every pair's h is a function of time with known derivatives h, L_f h, ..., L_f^q h
(jets). The derivatives s_0 ... s_q of h_tot = LSE(h_1, ..., h_r) follow, with w = softmax(ρ h):

    s_{k+1}   = Σ_p Σ_j binom(k,j) w_p^(j) h_p^(k+1-j)
    w_p^(k+1) = ρ Σ_j binom(k,j) w_p^(j) (h_p^(k+1-j) - s_{k+1-j})

ψ_0 ... ψ_q are functions of s_0 ... s_q alone, since s_k' = s_{k+1}.
"""

from collections.abc import Sequence
from functools import cache
from math import comb
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.expressions import exponential
from phalanx.theory.expressions.compiled import BoundFunction, MappedFunction, rounded_up
from phalanx.theory.expressions.portable import as_written, portable_function
from phalanx.theory.safety.class_k import ClassK
from phalanx.theory.safety.composition import FAR


class ComposedJets(NamedTuple):
    """The ψ-chain of h_tot at one state, without the inputs' part."""

    psi: Array
    """ψ_0 ... ψ_{q-1}, shape (q,); where no pair is composed ψ_0 is FAR."""
    unforced: float
    """Σ_l L_{f_l} ψ_{q-1}^{x_l} + α_q(ψ_{q-1})."""
    weights: Array
    """∂ψ_{q-1} / ∂(L_f^j h_p) for pair p and j = 0 ... q-1, shape (r, q); the last is w_p."""


class LogSumExpJets:
    """Composition of any number of pairs."""

    def __init__(self, rho: float, alphas: Sequence[ClassK], xi: float) -> None:
        """alphas: α_1 ... α_q. xi: ξ of Eq. (xi), unused if q = 1."""
        self._rho, self.degree = rho, len(alphas)
        self._chain = _chain_of_sum(rho, alphas, xi)
        s = ca.SX.sym("s", self.degree)
        # Only the unforced part, the last one, contains s_q.
        of_sum = _psi_of_sum(ca.vertcat(s, 0), alphas, xi)[:-1]
        self._psi = MappedFunction([s], of_sum)
        self.composition = cache(self._composition)
        """The function for a number of pairs, cached."""
        self._bound = cache(lambda room: BoundFunction(self.composition(room)))

    def __call__(self, h: Array) -> ComposedJets:
        """Compose r pairs, given h, L_f h, ..., L_f^q h of each; shape (r, q+1).

        The next call overwrites the weights.
        """
        bound, count, q = self._bound(rounded_up(len(h))), len(h), self.degree
        rows, (chain, weights) = bound.inputs[0].reshape(-1, q + 1), bound.outputs
        rows[:count] = h
        rows[count:] = 0.0
        rows[count:, 0] = FAR
        bound.call()
        return ComposedJets(chain[:q].copy(), chain.item(q), weights.reshape(-1, q)[:count])

    def psi(self, h_tot: Array, w: Array, h: Array) -> Array:
        """ψ_0 ... ψ_{q-1} alone at s states, shape (s, q).

        Args:
            h_tot: shape (s,).
            w: softmax(ρ h) of r pairs, 0 for all others, shape (s, r).
            h: h, L_f h, ..., L_f^{q-1} h of each, shape (s, r, q).
        """
        weights, s = [w], [h_tot]
        derivatives = [h[..., k] for k in range(self.degree)]
        for k in range(self.degree - 1):
            # Summed from left to right, so that pairs of weight 0 change no digit.
            s.append(np.add.accumulate(_leibniz(k, weights, derivatives[1:]), axis=1)[:, -1])
            off = [derivatives[j] - s[j][:, None] for j in range(1, k + 2)]
            weights.append(self._rho * _leibniz(k, weights, off))
        rows = np.column_stack(s)
        return self._psi(rows.ravel(), np.arange(rows.size).reshape(rows.shape))

    def flat(self, pairs: int) -> ca.Function:
        """Return `composition` of a column, pair after pair, with one column as result."""
        x = ca.MX.sym("x", (self.degree + 1) * pairs)
        chain, weights = self.composition(pairs)(ca.reshape(x, self.degree + 1, pairs))
        return ca.Function("f", [x], [ca.vertcat(chain, ca.vec(weights))])

    def _composition(self, pairs: int) -> ca.Function:
        """(q+1, pairs) -> ψ_0 ... ψ_{q-1} and the unforced part; the weights, (q, pairs).

        Unused columns have to contain FAR, with derivatives zero. The graph of operations on
        vectors does not grow with the number of pairs.
        """
        q, rho = self.degree, self._rho
        columns = ca.MX.sym("h", q + 1, pairs)
        h = [columns[k, :] for k in range(q + 1)]
        sigma = ca.mmax(h[0])
        with as_written():
            exponentials: ca.MX = exponential.exp(rho * (h[0] - sigma))
        total = ca.sum2(exponentials)
        w, s = [exponentials / total], [sigma, total]
        for k in range(q):
            s.append(ca.sum2(_leibniz(k, w, h[1:])))
            # h relative to its mean, so that nothing large cancels.
            w.append(rho * _leibniz(k, w, [h[j] - s[j + 1] for j in range(1, k + 2)]))
        chain = self._chain(ca.vertcat(*s))
        slopes = [chain[q + 1 + k] for k in range(q)]
        weights = [sum(slopes[k] * comb(k, j) * w[k - j] for k in range(j, q)) for j in range(q)]
        return ca.Function("composition", [columns], [chain[: q + 1], ca.vertcat(*weights)])


def _leibniz(k: int, a: Sequence[Any], b: Sequence[Any]) -> Any:
    """The k-th derivative of a product, from those of its factors."""
    return sum(comb(k, j) * a[j] * b[k - j] for j in range(k + 1))


def _psi_of_sum(s: ca.SX, alphas: Sequence[ClassK], xi: float) -> list[ca.SX]:
    """ψ_0 ... ψ_{q-1} and the unforced part as expressions of s_0 ... s_q."""
    psi, q = [s[0]], len(alphas)
    for degree, alpha in enumerate(alphas, start=1):
        drift = ca.jacobian(psi[-1], s[:q]) @ s[1:]
        disturbance = xi if degree == 1 and q > 1 else 0.0
        psi.append(drift + disturbance + alpha.value(psi[-1]))
    return psi


def _chain_of_sum(rho: float, alphas: Sequence[ClassK], xi: float) -> ca.Function:
    """(σ, Σ exp(ρ (h_p - σ)), s_1, ..., s_q) -> ψ_0 ... ψ_{q-1}, unforced, ∂ψ_{q-1}/∂s_k."""
    q = len(alphas)
    sigma, total = ca.SX.sym("sigma"), ca.SX.sym("total")
    s = ca.SX.sym("s", q + 1)
    psi = _psi_of_sum(s, alphas, xi)
    slopes = ca.densify(ca.jacobian(psi[q - 1], s[:q])).T
    (outputs,) = ca.substitute([ca.vertcat(*psi, slopes)], [s[0]], [sigma + ca.log(total) / rho])
    return portable_function([ca.vertcat(sigma, total, s[1:])], outputs)
