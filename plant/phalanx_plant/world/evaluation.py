"""The safe-set functions of every state in the world's history, from the relevant pairs alone.

A pair is relevant if its h can be above zero or can change h_tot. For the safe-set functions that
come with Phalanx the distance is known beyond which h is below a given level. Pairs whose h is
below zero, and too far below the largest one to change h_tot, are left out. A spatial index finds
the others; its answer is kept until an agent has moved too far.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.safety.function import Reaching, proven_reach, static_reach
from phalanx.theory.safety.pairs import PairFunctions
from phalanx_plant.world.resolution import Resolution, Roundings
from phalanx_plant.world.segments import Segments, segments_of
from phalanx_plant.world.world import History

_DIGITS = 60.0 * math.log(2.0)
_STATES_AT_ONCE, _ROWS_AT_ONCE = 128, 8192
"""Fewest states that are evaluated together, and rows of pairs, which then stay in a cache."""
_SLACK = 0.25
"""Share by which the search goes farther than it must, so that its result lasts for a while."""
_FEW = 40
"""So many pairs take as long to evaluate as to look up (18 of `unicycles`: 6 % more), and need no
tree, whose import alone takes .3 s."""
_FEW_ROWS = 500
"""The same where each pair has a row of its own, so that all its ψ are evaluated wherever its
agents are; in time it makes no difference (`guaranteed`, `swarm2d`: within 10 %)."""


class EvaluatedSteps(NamedTuple):
    """Safe-set functions after each of s integration steps."""

    numbers: Index
    """Number of each step's history, shape (s,)."""
    times: Array
    """[s], shape (s,)"""
    pairs: Index
    """Relevant pairs, shape (r,): no other one that counts has a larger h, or one above zero."""
    h: Array
    """h of each of them, shape (s, r)."""
    h_tot: Array
    """Composition of all pairs, shape (s,)."""
    psi: Array
    """The largest ψ_1 ... ψ_{q-1}, shape (s,); empty if q = 1."""
    resolved: Mask
    """Whether each step is proven to follow the equation of motion, shape (s,)."""


class Evaluation:
    """h of the relevant pairs, h_tot and ψ along the world's history.

    No sample depends on them, so they are computed when there is time: while agents compute.
    """

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self._psi = LargestPsi(rows)
        self.pairs = RelevantPairs(swarm, self._psi.functions)
        self._resolution = swarm.functions.get(Resolution, lambda: Resolution(swarm))
        self._roundings = Roundings(swarm.time.integration_step)
        rho, pairs = swarm.safety.rho, len(swarm.safe_set.pairs)
        self._sum = swarm.functions.get((LogSumExp, pairs), lambda: LogSumExp(rho, pairs))

    def of(self, histories: Sequence[History]) -> Iterator[EvaluatedSteps]:
        """Evaluate the steps of consecutive histories, in their order."""
        segments = segments_of(histories)
        return iter(()) if segments is None else self.of_segments(segments)

    def of_segments(self, segments: Segments) -> Iterator[EvaluatedSteps]:
        """Evaluate the steps of segments, of which there are some."""
        counts, x, positions = segments.counts, segments.x, segments.p
        numbers = segments.history.repeat(counts)
        ordinals = 1 + np.arange(len(x)) - (np.cumsum(counts) - counts).repeat(counts)
        times = segments.t.repeat(counts) + segments.dt.repeat(counts) * ordinals
        resolved = self._resolution.resolved(segments, self._roundings.rates(times, x))
        for first in range(0, len(x), self.pairs.at_once):
            some = slice(first, first + self.pairs.at_once)
            pairs, values, least = self.pairs(x[some], positions[some])
            h = values[..., 0]
            composed = self._sum(h)
            yield EvaluatedSteps(
                numbers[some],
                times[some],
                pairs,
                h,
                composed.h_tot,
                self._psi(x[some], values, least, composed),
                resolved[some],
            )


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


class PairValues(NamedTuple):
    """The relevant pairs at s states."""

    pairs: Index
    """Indices of the pairs, shape (r,)."""
    values: Array
    """Values of the functions, h first, shape (s, r, q)."""
    least: Array
    """Pairs with a smaller h are irrelevant, whether left out or not, shape (s,)."""


class RelevantPairs:
    """Evaluates functions of the relevant pairs."""

    def __init__(self, swarm: Swarm, functions: PairFunctions) -> None:
        """Begin with every pair; `functions` are h of a pair, and others to evaluate with it."""
        scenario, function = swarm.scenario, swarm.safety.safe_set_function
        self._functions = functions
        self._obstacles = scenario.static
        self._normal = np.array([not m.adversary for m in swarm.members])
        self._every = swarm.pairs.every
        few = len(self._every) <= (_FEW_ROWS if swarm.safety.pairwise else _FEW)
        self._function = None if few else proven_reach(function)
        self.at_once = max(_STATES_AT_ONCE, _ROWS_AT_ONCE // len(self._every) if few else 0)
        """States that are best evaluated together."""
        if self._function is not None:
            _spatial_index()  # now, and not in the middle of the run
        self._negligible = negligible_below(swarm.safety.rho, len(self._every))
        self.excluded: Mask = np.zeros(len(self._every), dtype=bool)
        """Pairs that make no other one irrelevant, shape (p,)."""
        members = len(swarm.members)
        self._numbers = np.full((members, members + len(scenario.static)), -1)
        self._numbers[tuple(self._every.T)] = np.arange(len(self._every))
        """The number of a pair of members at (a, b), of a and obstacle k at (a, N + k)."""
        self._choose(self._every)

    def __call__(self, x: Array, positions: Array) -> PairValues:
        """Evaluate at stacked states x, (s, n̄), with output positions [m], (s, N, d)."""
        values = self._chosen(x)
        if self._function is not None and not self._complete(positions, values[..., 0]):
            self._search(self._function, positions[0], values[..., 0])
            values = self._chosen(x)
            if not self._complete(positions, values[..., 0]):
                self._choose(self._every)
                values = self._chosen(x)
        return PairValues(self._chosen_numbers, values, self._least(values[..., 0]))

    def _choose(self, pairs: Index) -> None:
        self._chosen = self._functions.choose(pairs)
        a, b = self._chosen.pairs.T
        self._chosen_numbers = self._numbers[a, b]
        self._from: Array | None = None

    def _least(self, h: Array) -> Array:
        """Return PairValues.least for the h of some pairs."""
        if self._function is None:
            return np.full(len(h), -np.inf)
        # If pairs are missing, the largest h found is too small, which is safe.
        counted = np.where(self.excluded[self._chosen_numbers], -np.inf, h)
        least: Array = np.minimum(0.0, counted.max(axis=1) - self._negligible)
        return least

    def _complete(self, positions: Array, h: Array) -> bool:
        """Return whether the chosen pairs include all that are relevant at these states."""
        if self._from is None or not self._level <= self._least(h).min():
            return False
        moved = positions - self._from
        return bool(dot(moved, moved).max() <= self._room * self._room)

    def _search(self, function: Reaching, positions: Array, h: Array) -> None:
        """Choose the pairs that are relevant near these positions, (N, d), given h of some."""
        self._level = float(self._least(h).min()) - _SLACK * self._negligible
        reach = function.reach(self._level)
        self._room = _SLACK * reach / 2.0
        if not math.isfinite(reach):
            self._choose(self._every)
            return
        tree = _spatial_index()(positions)
        pairs = tree.query_pairs(reach + 2.0 * self._room, output_type="ndarray")
        # A normal member comes first; two adversaries are no pair of the safe set.
        pairs = np.where(self._normal[pairs[:, :1]], pairs, pairs[:, ::-1])
        blocks = [pairs[self._normal[pairs[:, 0]]]]
        for k, obstacle in enumerate(self._obstacles):
            close = static_reach(function, self._level, obstacle) + self._room
            near = np.flatnonzero(self._normal & (obstacle.distances(positions) <= close))
            blocks.append(np.stack([near, np.full(len(near), len(positions) + k)], axis=1))
        every = np.concatenate(blocks)
        # In the order of all pairs: sums then have the same bits, whichever pairs are left out.
        self._choose(self._every[np.sort(self._numbers[tuple(every.T)])])
        self._from = positions


def _spatial_index() -> Callable[[Array], Any]:
    """Import cKDTree, which takes most of a second: small swarms do without it."""
    from scipy.spatial import cKDTree

    index: Callable[[Array], Any] = cKDTree
    return index
