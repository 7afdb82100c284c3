"""What the plots are made of: time series of a run's past."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_FIRST_CAPACITY = 256
LEAST_HORIZON = 0.1
"""Where a certified time is drawn that is shorter than this many τ."""


class TimeSeries:
    """Rows of numbers, time [s] first, appended one by one or given at once."""

    def __init__(self, width: int, rows: Array | None = None) -> None:
        self._rows = np.zeros((_FIRST_CAPACITY, width)) if rows is None else rows
        self._count = 0 if rows is None else len(rows)

    def append(self, *row: float) -> None:
        """Add a row."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1

    @property
    def rows(self) -> Array:
        """All rows so far, shape (s, width)."""
        return self._rows[: self._count]


@dataclass(frozen=True)
class History:
    """A run's past."""

    swarm: TimeSeries
    """t, h_tot, smallest distance of a pair of agents, shortest and median certified time of the
    normal agents [τ], ψ_1 ... ψ_{q-1}."""
    agent: Callable[[int], Array]
    """One agent's rows: t, 1 at a backup step, age of the oldest û, solve time, how long it is
    certified, its input."""


def nan_if_none(value: float | None) -> float:
    """Plots leave out what is not a number."""
    return float("nan") if value is None else value


def until(rows: Array, t: float) -> Array:
    """The rows whose first number is at most t."""
    return rows[: np.searchsorted(rows[:, 0], t, side="right")]


def certified_horizon(rows: Array, tau: float, most: int) -> tuple[Array, Array]:
    """When and for how many τ an agent's inputs were certified, of History.agent's rows.

    At most `most` of them, the shortest kept, and none below LEAST_HORIZON, for a logarithm.
    """
    known = rows[np.isfinite(rows[:, 4])]
    shown = thinned(np.column_stack([known[:, 0], -known[:, 4]]), most)
    return shown[:, 0], np.maximum(-shown[:, 1] / tau, LEAST_HORIZON)


def shortest_and_median(horizons: Array) -> Array:
    """Of normal agents' certified times [τ], shape (s, n); shape (s, 2), NaN where all are."""
    found = np.full((len(horizons), 2), np.nan)
    known = np.isfinite(horizons).any(axis=1)
    found[known, 0] = np.nanmin(horizons[known], axis=1)
    found[known, 1] = np.nanmedian(horizons[known], axis=1)
    return found


def swarm_horizons(rows: Array, most: int) -> Array:
    """When, shortest and median certified time, of History.swarm's rows, shape (s, 3).

    At most `most` of them, the shortest kept, and none below LEAST_HORIZON, for a logarithm.
    """
    known = rows[np.isfinite(rows[:, 3])][:, [0, 3, 4]] * [1.0, -1.0, 1.0]
    shown = thinned(known, most) * [1.0, -1.0, 1.0]
    return np.column_stack([shown[:, 0], np.maximum(shown[:, 1:], LEAST_HORIZON)])


def thinned(rows: Array, most: int) -> Array:
    """At most `most` rows that keep every column-1 peak: of each block the row where it is."""
    if len(rows) <= most:
        return rows
    edges = np.linspace(0, len(rows), most + 1).astype(int)
    peaks = [a + int(np.argmax(rows[a:b, 1])) for a, b in pairwise(edges)]
    return np.asarray(rows[peaks])
