"""The safe-set functions of every state in the world's history."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from phalanx.swarm.rows import SafetyRows
from phalanx.swarm.swarm import DEFECT
from phalanx.theory.arrays import Array, Index, Mask
from phalanx_plant.world.composition import LargestPsi, LogSumExp
from phalanx_plant.world.relevant_pairs import RelevantPairs
from phalanx_plant.world.resolution import Resolution, Roundings
from phalanx_plant.world.world import History, Segment

_STATES_AT_ONCE = 64


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
        numbered = [
            (k, p) for k, history in enumerate(histories) for p in history if type(p) is Segment
        ]
        if not numbered:
            return
        segments = [p for _, p in numbered]
        counts = [p.x.shape[0] for p in segments]
        steps = np.array([(k, p.t, p.dt) for k, p in numbered]).repeat(counts, axis=0)
        ordinals = np.array([n for count in counts for n in range(1, count + 1)])
        numbers, times = steps[:, 0].astype(np.intp), steps[:, 1] + steps[:, 2] * ordinals
        x = np.concatenate([p.x for p in segments])
        positions = np.concatenate([p.p for p in segments])
        defects = self._resolution.defects(segments).repeat(counts)
        resolved = defects + self._roundings.rates(times, x) <= DEFECT
        for first in range(0, len(x), _STATES_AT_ONCE):
            some = slice(first, first + _STATES_AT_ONCE)
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
