"""What the safe set says of every state that the world went through."""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index, Mask
from phalanx.swarm.rows import SafetyRows
from phalanx_plant.world.composition import LargestPsi, LogSumExp
from phalanx_plant.world.near import NearPairs
from phalanx_plant.world.resolution import Resolution
from phalanx_plant.world.world import DisturbanceKnot, Passage, Piece

_STATES_AT_ONCE = 32


class IntegrationSteps(NamedTuple):
    """What s integration steps showed."""

    times: Array
    """[s], shape (s,)"""
    pairs: Index
    """Which pairs count, shape (r,): no other is above them or above zero."""
    h: Array
    """Of each, shape (s, r)."""
    h_tot: Array
    """Of all pairs, shape (s,)."""
    psi: Array
    """The largest of their ψ_1 ... ψ_{q-1}, shape (s,); empty if q = 1."""
    resolved: Mask
    """Whether each is known to keep to the equation of motion, shape (s,)."""

    def part(self, some: slice) -> "IntegrationSteps":
        """Some of them."""
        times, pairs, h, h_tot, psi, resolved = self
        return IntegrationSteps(times[some], pairs, h[some], h_tot[some], psi[some], resolved[some])


Way = list[Piece]
Seen = list[IntegrationSteps | DisturbanceKnot]


class Truth:
    """h of the pairs that count, h_tot and ψ along the way.

    Nobody's sample needs them, so they are looked at when there is time: while agents compute.
    """

    def __init__(self, rows: SafetyRows) -> None:
        swarm = rows.swarm
        self._psi = LargestPsi(rows)
        self._near = NearPairs(swarm, self._psi.functions)
        self._resolution = Resolution(swarm)
        self._sum = LogSumExp(swarm.safety.rho, len(swarm.safe_set.pairs))

    def of(self, ways: Sequence[Way]) -> list[Seen]:
        """What each of these ways, one after the other, showed; its knots first."""
        shown: list[Seen] = [[p for p in way if isinstance(p, DisturbanceKnot)] for way in ways]
        passages = [(k, p) for k, way in enumerate(ways) for p in way if isinstance(p, Passage)]
        if not passages:
            return shown
        times = np.concatenate([p.times for _, p in passages])
        x = np.concatenate([p.x for _, p in passages])
        positions = np.concatenate([p.p for _, p in passages])
        each = self._resolution.resolves([p for _, p in passages])
        resolved = each.repeat([len(p.x) for _, p in passages])
        whose = np.array([k for k, p in passages for _ in p.x])
        for first in range(0, len(x), _STATES_AT_ONCE):
            some = slice(first, first + _STATES_AT_ONCE)
            steps, begin = self._steps(times[some], x[some], positions[some], resolved[some]), 0
            for k, count in Counter(whose[some].tolist()).items():
                shown[k].append(steps.part(slice(begin, begin := begin + count)))
        return shown

    def _steps(self, times: Array, x: Array, positions: Array, resolved: Mask) -> IntegrationSteps:
        pairs, values, least = self._near(x, positions)
        h = values[..., 0]
        composed = self._sum(h)
        psi = self._psi(values, least, composed)
        return IntegrationSteps(times, pairs, h, composed.h_tot, psi, resolved)
