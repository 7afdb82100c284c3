"""What the safe set says of every state that the world went through."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.plant.world.motion import Motion
from phalanx.plant.world.near import NearPairs
from phalanx.plant.world.psi import LargestPsi
from phalanx.plant.world.world import DisturbanceKnot, DivergedError, Passage
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.mapped import Index

Array = NDArray[np.float64]

_STATES_AT_ONCE = 16


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


class Truth:
    """h of the pairs that count, h_tot and ψ along the way.

    Nobody's sample needs them, so they are looked at when there is time: while agents compute.
    """

    def __init__(self, rows: SafetyRows, motion: Motion) -> None:
        self._near = NearPairs(rows.swarm, motion)
        self._psi = LargestPsi(rows)

    def of(self, way: list[Passage | DisturbanceKnot]) -> list[IntegrationSteps | DisturbanceKnot]:
        """The same way, its knots first. Raises DivergedError."""
        knots = [piece for piece in way if isinstance(piece, DisturbanceKnot)]
        return [*knots, *self._steps([p for p in way if isinstance(p, Passage)])]

    def _steps(self, passages: list[Passage]) -> Iterator[IntegrationSteps]:
        if not passages:
            return
        times = np.concatenate([passage.times for passage in passages])
        x = np.concatenate([passage.x for passage in passages])
        for first in range(0, len(x), _STATES_AT_ONCE):
            some = slice(first, first + _STATES_AT_ONCE)
            pairs, h, h_tot = self._near(x[some])
            if not np.isfinite(h_tot).all():
                raise DivergedError("h_tot", times[some][-1])
            psi = self._psi(x[some], self._near.chosen)
            yield IntegrationSteps(times[some], pairs, h, h_tot, psi)
