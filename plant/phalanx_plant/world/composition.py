"""h_tot and the largest ψ at many states, from the few pairs that contribute to them."""

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.safety.pairs import PairFunctions

_DIGITS = 60.0 * math.log(2.0)


def negligible_below(rho: float, pairs: int) -> float:
    """Distance below the largest h beyond which a pair does not change h_tot.

    All pairs left out together are at most 2^-60 of Σ exp(ρ (h - σ)): less than half its last
    digit.
    """
    return (_DIGITS + math.log(pairs)) / rho


class Composed(NamedTuple):
    """Log-sum-exp (LSE) of r pairs at s states."""

    h_tot: Array
    """shape (s,)"""
    weights: Array
    """softmax(ρ h), shape (s, r); 0 for pairs too far below the largest to change h_tot."""


class LogSumExp:
    """LSE of any number of h, at several states in one call."""

    def __init__(self, rho: float, pairs: int) -> None:
        """Compile the sum with sharpness ρ, of at most this many pairs."""
        below, sigma, total = ca.SX.sym("below"), ca.SX.sym("sigma"), ca.SX.sym("total")
        self._exponential = MappedFunction([below], [ca.exp(rho * below)])
        self._logarithm = MappedFunction([sigma, total], [sigma + ca.log(total) / rho])
        self._negligible = negligible_below(rho, pairs)

    def __call__(self, h: Array) -> Composed:
        """Compose h, shape (s, r)."""
        sigma = h.max(axis=1)
        with np.errstate(invalid="ignore"):  # an infinite h is reported by the judge
            below = h - sigma[:, None]
        states, pairs = np.nonzero(~(below < -self._negligible))
        exponentials = self._exponential(below[states, pairs], np.arange(len(states))[:, None])
        exponentials = exponentials[:, 0]
        # From left to right: the same sum, whichever of the others were left out beforehand.
        total = np.bincount(states, exponentials, len(h))
        of_both = self._logarithm(np.column_stack([sigma, total]), np.array([[0, 1]]))[:, 0, 0]
        weights = np.zeros(h.shape)
        weights[states, pairs] = exponentials / total[states]
        return Composed(of_both, weights)


class LargestPsi:
    """The largest of ψ_1 ... ψ_{q-1}; while it is at most 0 the true state stays in S_I.

    Each pair has its own chain, or all are composed, as agents do it. Neighbourhoods are ignored:
    the composition is of all pairs.
    """

    def __init__(self, rows: SafetyRows) -> None:
        self._rows, pairs = rows, rows.swarm.pairs
        kinds = [0 for _ in rows.swarm.members]
        along_drift = PairFunctions(pairs, kinds, lambda _, kind: pairs.kinds[kind].along_drift)
        self.functions = rows.pair_psi if rows.swarm.safety.pairwise else along_drift
        """Functions needed of a pair: ψ_0 ... ψ_{q-1}, or h, L_f h, ..., L_f^{q-1} h."""

    def __call__(self, x: Array, pairs: Array, least: Array, composed: Composed) -> Array:
        """Evaluate at s states, shape (s,); empty if q = 1.

        Args:
            x: stacked states, shape (s, n̄).
            pairs: values of the functions for each pair, shape (s, r, q).
            least: pairs with a smaller h are ignored if each has its own chain, shape (s,).
            composed: the same pairs composed.
        """
        if self._rows.relative_degree == 1:
            return np.zeros(0)
        if self._rows.swarm.safety.pairwise:
            counting = pairs[..., 0] >= least[:, None]
            psi = np.where(counting, pairs[..., 1:].max(axis=2), -np.inf)
        else:
            some = np.flatnonzero(composed.weights.any(axis=0))
            jets = self._rows.composed.jets
            psi = jets.psi(composed.h_tot, composed.weights[:, some], pairs[:, some])[:, 1:]
        largest: Array = psi.max(axis=1)
        return largest
