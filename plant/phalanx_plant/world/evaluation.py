"""The safe-set functions of every state in the world's history."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index, Mask
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.models.world import WorldNote
from phalanx_plant.world.composition import LargestPsi, LogSumExp
from phalanx_plant.world.relevant_pairs import RelevantPairs
from phalanx_plant.world.resolution import Resolution
from phalanx_plant.world.world import DisturbanceKnot, History, Segment

_STATES_AT_ONCE = 32


class EvaluatedSteps(NamedTuple):
    """Safe-set functions after each of s integration steps."""

    times: Array
    """[s], shape (s,)"""
    pairs: Index
    """Relevant pairs, shape (r,): no other has a larger h, or one above zero."""
    h: Array
    """h of each of them, shape (s, r)."""
    h_tot: Array
    """Composition of all pairs, shape (s,)."""
    psi: Array
    """The largest ψ_1 ... ψ_{q-1}, shape (s,); empty if q = 1."""
    resolved: Mask
    """Whether each step is proven to follow the equation of motion, shape (s,)."""

    def part(self, some: slice) -> "EvaluatedSteps":
        """Return a range of the steps."""
        times, pairs, h, h_tot, psi, resolved = self
        return EvaluatedSteps(times[some], pairs, h[some], h_tot[some], psi[some], resolved[some])


EvaluatedHistory = list[EvaluatedSteps | DisturbanceKnot | WorldNote]


class Evaluation:
    """h of the relevant pairs, h_tot and ψ along the world's history.

    No sample depends on them, so they are computed when there is time: while agents compute.
    """

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self._psi = LargestPsi(rows)
        self._pairs = RelevantPairs(swarm, self._psi.functions)
        self._resolution = swarm.once(Resolution)
        self._sum = LogSumExp(swarm.safety.rho, len(swarm.safe_set.pairs))

    def of(self, histories: Sequence[History]) -> list[EvaluatedHistory]:
        """Evaluate consecutive histories; in each result the steps come last."""
        found: list[EvaluatedHistory] = [
            [p for p in history if not isinstance(p, Segment)] for history in histories
        ]
        numbered = [
            (k, p) for k, history in enumerate(histories) for p in history if type(p) is Segment
        ]
        if not numbered:
            return found
        segments = [p for _, p in numbered]
        times = np.concatenate([p.times for p in segments])
        x = np.concatenate([p.x for p in segments])
        positions = np.concatenate([p.p for p in segments])
        resolved = self._resolution.resolves(segments).repeat([len(p.x) for p in segments])
        number = np.array([k for k, p in numbered for _ in p.x])
        for first in range(0, len(x), _STATES_AT_ONCE):
            some = slice(first, first + _STATES_AT_ONCE)
            steps, begin = self._steps(times[some], x[some], positions[some], resolved[some]), 0
            for k, count in Counter(number[some].tolist()).items():
                found[k].append(steps.part(slice(begin, begin := begin + count)))
        return found

    def _steps(self, times: Array, x: Array, positions: Array, resolved: Mask) -> EvaluatedSteps:
        pairs, values, least = self._pairs(x, positions)
        h = values[..., 0]
        composed = self._sum(h)
        psi = self._psi(values, least, composed)
        return EvaluatedSteps(times, pairs, h, composed.h_tot, psi, resolved)
