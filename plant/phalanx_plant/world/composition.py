"""h_tot and the largest ψ of many states at once, of pairs of which few have a part in them."""

import math
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.safety.pairs import PairFunctions

_DIGITS = 60.0 * math.log(2.0)


def allowance(rho: float, pairs: int) -> float:
    """How far below the largest h nothing counts, of so many pairs.

    All that is left out is at most 2^-60 of Σ exp(ρ (h - σ)): less than half its last digit.
    """
    return (_DIGITS + math.log(pairs)) / rho


class Composed(NamedTuple):
    """LSE of r pairs at s states."""

    h_tot: Array
    """shape (s,)"""
    weights: Array
    """softmax(ρ h), shape (s, r); 0 for pairs that are too far below the largest to count."""


class LogSumExp:
    """LSE of any number of h, of several states at once."""

    def __init__(self, rho: float, pairs: int) -> None:
        """pairs: how many there are at most."""
        below, sigma, total = ca.SX.sym("below"), ca.SX.sym("sigma"), ca.SX.sym("total")
        self._exponential = MappedFunction([below], [ca.exp(rho * below)])
        self._logarithm = MappedFunction([sigma, total], [sigma + ca.log(total) / rho])
        self._allowance = allowance(rho, pairs)

    def __call__(self, h: Array) -> Composed:
        """Of h, shape (s, r)."""
        sigma = h.max(axis=1)
        with np.errstate(invalid="ignore"):  # h may be infinite, which whoever asked will find
            below = h - sigma[:, None]
        states, pairs = np.nonzero(~(below < -self._allowance))
        each = self._exponential(below[states, pairs], np.arange(len(states))[:, None])[:, 0]
        # From left to right: the same sum, whichever of the others were left out beforehand.
        total = np.bincount(states, each, len(h))
        of_both = self._logarithm(np.column_stack([sigma, total]), np.array([[0, 1]]))[:, 0, 0]
        weights = np.zeros(h.shape)
        weights[states, pairs] = each / total[states]
        return Composed(of_both, weights)


class LargestPsi:
    """Whether the truth stays in S_I: the largest of all ψ_1 ... ψ_{q-1} of the pairs that count.

    Each pair for itself or composed, as agents keep them.

    Neighbourhoods are left out: the composition is of all pairs.
    """

    def __init__(self, rows: SafetyRows) -> None:
        self._rows, pairs = rows, rows.swarm.pairs
        sorts = [0 for _ in rows.swarm.members]
        along_drift = PairFunctions(pairs, sorts, lambda _, kind: pairs.kinds[kind].along_drift)
        self.functions = rows.pair_psi if rows.swarm.safety.pairwise else along_drift
        """What it needs of a pair: ψ_0 ... ψ_{q-1}, or h, L_f h, ..., L_f^{q-1} h."""

    def __call__(self, pairs: Array, least: Array, composed: Composed) -> Array:
        """At s states, shape (s,); empty if q = 1.

        Args:
            pairs: what the functions say of each, shape (s, r, q).
            least: no pair whose h is less counts for itself, shape (s,).
            composed: of the same pairs.
        """
        if self._rows.relative_degree == 1:
            return np.zeros(0)
        if self._rows.swarm.safety.pairwise:
            counting = pairs[..., 0] >= least[:, None]
            each = np.where(counting, pairs[..., 1:].max(axis=2), -np.inf)
        else:
            some = np.flatnonzero(composed.weights.any(axis=0))
            jets = self._rows.composed.jets
            each = jets.psi(composed.h_tot, composed.weights[:, some], pairs[:, some])[:, 1:]
        largest: Array = each.max(axis=1)
        return largest
