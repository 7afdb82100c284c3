"""A run's past, as the plots show it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.faults.commands import Condition
from phalanx.recording.broadcasts import LATE, LOST, Broadcast
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.composition import FAR
from phalanx.wire.step_report import QUANTITIES

_FIRST_CAPACITY = 256
NOBODY_NEAR = 1e-3 * FAR
"""A residual this small is no row's: no pair was composed, so that none had to be kept."""


class TimeSeries:
    """Rows of numbers, time [s] first, appended one by one or given at once."""

    def __init__(self, width: int, rows: Array | None = None) -> None:
        self._rows = np.zeros((_FIRST_CAPACITY, width)) if rows is None else rows
        self._count = 0 if rows is None else len(rows)

    def append(self, row: Array | list[float]) -> None:
        """Add a row, shape (width,)."""
        if self._count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self._count] = row
        self._count += 1

    @property
    def rows(self) -> Array:
        """All rows so far, shape (s, width)."""
        return self._rows[: self._count]


class AgentSeries(NamedTuple):
    """One agent's control steps; NaN where something is not known."""

    t: Array
    """When the inputs were applied [s], shape (s,)."""
    empty: Array
    """What became of a step with empty K_i, as EMPTY_CODES has it; else 0."""
    numbers: dict[str, Array]
    """By their names in QUANTITIES."""
    u: Array
    """Applied inputs, shape (s, m_i)."""
    u_nom: Array
    """Nominal inputs, shape (s, m_i)."""


_PAIR_VALUES = 2_000_000


def pair_states(pairs: int, most: int) -> int:
    """At how many states of a run h of all pairs is told: it costs more than all else here."""
    return max(min(most, _PAIR_VALUES // max(pairs, 1)), 1)


EMPTY_CODES: dict[str, float] = {Origin.BACKUP: 1.0, Origin.NO_AUTHORITY: 2.0}
"""How AgentSeries.empty tells what became of a step with empty K_i."""


def series_width(inputs: int) -> int:
    """How many columns the rows of AgentSeries have, of an agent with so many inputs."""
    return 2 + len(QUANTITIES) + 2 * inputs


def agent_series(rows: Array) -> AgentSeries:
    """From rows in the order of AgentSeries, shape (s, series_width(m_i))."""
    t, empty, *values = rows[:, : series_width(0)].T
    u, u_nom = np.hsplit(rows[:, series_width(0) :], 2)
    return AgentSeries(t, empty, dict(zip(QUANTITIES, values, strict=True)), u, u_nom)


class PairSeries(NamedTuple):
    """h of every pair."""

    t: Array
    """[s], shape (s,)."""
    h: Array
    """Shape (s, p), in the order of the composed set's pairs."""


class Fates(NamedTuple):
    """What became of broadcasts; a row for one, or for several to one agent. Each of shape (b,)."""

    t: Array
    """When they were sent [s]."""
    receiver: Array
    sent: Array
    """How many."""
    late: Array
    """How many of them."""
    lost: Array


def fates_of(broadcasts: Sequence[Broadcast]) -> Fates:
    """A row for each."""
    rows = [(b.sent, b.receiver, 1.0, b.fate == LATE, b.fate == LOST) for b in broadcasts]
    return Fates(*np.array(rows, dtype=float).reshape(-1, 5).T)


class ConditionChange(NamedTuple):
    """From when on an agent is in a condition."""

    t: float
    """[s]"""
    agent: int
    condition: Condition


@dataclass(frozen=True)
class History:
    """A run's past."""

    swarm: TimeSeries
    """t, h_tot, smallest distance of a pair of agents, ψ_1 ... ψ_{q-1}."""
    agent: Callable[[int], AgentSeries]
    """What one agent did."""
    pairs: Callable[[], PairSeries]
    """h of every pair at some of the times of `swarm`, the worst ones among them."""
    fates: Callable[[], Fates]
    """Of all broadcasts; of a live run with many agents of none."""
    broadcasts: Sequence[Broadcast] = ()
    """Every broadcast, of a recorded run: a live one tells of late and lost ones alone."""
    conditions: list[ConditionChange] = field(default_factory=list)
    """In order; every agent is fine at first."""
