"""A run's past as arrays."""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.distance import cdist

from phalanx.arrays import Array
from phalanx.curves.values import SafetyValues
from phalanx.faults.commands import Condition, FaultState
from phalanx.recording.broadcasts import LATE, LOST, Broadcast, broadcasts
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.composition import Pair
from phalanx.wire.step_report import QUANTITIES, numbers_of

EMPTY_CODES: dict[str, float] = {Origin.BACKUP: 1.0, Origin.NO_AUTHORITY: 2.0}
"""How AgentSeries.empty tells what became of a step with empty K_i."""
_PAIR_STATES, _PAIR_VALUES = 400, 2_000_000


class AgentSeries(NamedTuple):
    """One agent's control steps; NaN where something is not known."""

    t: Array
    """When the inputs were applied [s], shape (s,)."""
    sampled: Array
    """When the samples were taken [s]; of a live run, as t."""
    empty: Array
    """What became of a step with empty K_i, as EMPTY_CODES has it; else 0."""
    numbers: dict[str, Array]
    """By their names in QUANTITIES."""
    u: Array
    """Applied inputs, shape (s, m_i)."""
    u_nom: Array
    """Nominal inputs, shape (s, m_i)."""


def series_width(inputs: int) -> int:
    """How many columns the rows of agent_series have, of an agent with so many inputs."""
    return 2 + len(QUANTITIES) + 2 * inputs


def agent_series(rows: Array, sampled: Array | None = None) -> AgentSeries:
    """From rows of t, empty, the numbers, u and u_nom, shape (s, series_width(m_i))."""
    t, empty, *values = rows[:, : series_width(0)].T
    u, u_nom = np.hsplit(rows[:, series_width(0) :], 2)
    numbers = dict(zip(QUANTITIES, values, strict=True))
    return AgentSeries(t, t if sampled is None else sampled, empty, numbers, u, u_nom)


def recorded_series(steps: Sequence[Step], inputs: int) -> AgentSeries:
    """An agent's recorded steps; inputs: how many it has."""
    rows = [
        [
            s.t_apply,
            EMPTY_CODES.get(s.origin, 0.0),
            *numbers_of(s),
            *s.u,
            *(s.u_nom or [None] * inputs),
        ]
        for s in steps
    ]
    # NumPy makes NaN of None.
    values = np.array(rows, dtype=float).reshape(-1, series_width(inputs))
    return agent_series(values, np.array([s.t for s in steps]))


class PairSeries(NamedTuple):
    """h of every pair."""

    t: Array
    """[s], shape (s,)."""
    h: Array
    """Shape (s, p), in the order of the composed set's pairs."""


def pair_states(pairs: int, most: int) -> int:
    """At how many states of a run h of all pairs is told: it costs more than all else here."""
    return max(min(most, _PAIR_VALUES // max(pairs, 1)), 1)


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


def fates_of(found: Sequence[Broadcast]) -> Fates:
    """A row for each."""
    rows = [(b.sent, b.receiver, 1.0, b.fate == LATE, b.fate == LOST) for b in found]
    return Fates(*np.array(rows, dtype=float).reshape(-1, 5).T)


class ConditionChange(NamedTuple):
    """From when on an agent is in a condition."""

    t: float
    """[s]"""
    agent: int
    condition: Condition


class History(Protocol):
    """The past of a run, recorded or live."""

    @property
    def totals(self) -> Array:
        """t, h_tot, the swarm's smallest distance, ψ_1 ... ψ_{q-1}: a row for each state."""

    @property
    def pairs(self) -> PairSeries:
        """h of every pair at some of the times of `totals`, the worst ones among them."""

    @property
    def fates(self) -> Fates:
        """Of all broadcasts; of a live run with many agents of none."""

    @property
    def broadcasts(self) -> Sequence[Broadcast]:
        """Every broadcast, of a recorded run: a live one tells of late and lost ones alone."""

    @property
    def conditions(self) -> Sequence[ConditionChange]:
        """In order; every agent is fine at first."""

    def agent(self, i: int) -> AgentSeries:
        """What one agent did."""


class RecordedHistory:
    """The past of a recording: each part is worked out when it is first asked for."""

    def __init__(self, recording: Recording, values: SafetyValues) -> None:
        self.recording, self.values = recording, values
        self.scenario, self.swarm = recording.scenario, values.rows.swarm
        self.times, self.x, self.h_tot = recording.times, recording.x, recording.h_tot
        """Of the states, shapes (s,), (s, n̄) and (s,)."""
        self.steps = list(steps_by_agent(recording).values())
        """Of each agent."""

    @property
    def worst(self) -> int:
        """Index of the state with the largest h_tot."""
        return int(np.argmax(self.h_tot))

    @cached_property
    def positions(self) -> Array:
        """Output points [m], shape (s, N, 2) or (s, N, 3)."""
        return np.array([self.swarm.positions(x) for x in self.x])

    def distance(self, pair: Pair) -> Array:
        """Distance between a pair's output points, or from a center or a wall [m], (s,).

        0 from a limit: it is everywhere.
        """
        own = self.positions[:, pair.a]
        if pair.b is None:
            return self.scenario.static[pair.obstacle or 0].distances(own)
        apart: Array = np.linalg.norm(own - self.positions[:, pair.b], axis=1)
        return apart

    @cached_property
    def totals(self) -> Array:
        """As History has it."""
        distances = [smallest_distance(self.swarm, p) for p in self.positions]
        psi = np.array([self.values.higher_psi(x) for x in self.x])
        return np.column_stack([self.times, self.h_tot, distances, psi])

    @cached_property
    def pairs(self) -> PairSeries:
        """At the worst state of each block of time: all of them would be many, of many pairs."""
        count = pair_states(len(self.swarm.safe_set.pairs), min(_PAIR_STATES, len(self.times)))
        blocks = np.array_split(np.arange(len(self.times)), count)
        worst = [block[int(np.argmax(self.h_tot[block]))] for block in blocks]
        # One state at a time: for several at once it takes half as much memory again.
        h = np.array([self.values.every_h(x) for x in self.x[worst]])
        return PairSeries(self.times[worst], h)

    @cached_property
    def broadcasts(self) -> list[Broadcast]:
        """As History has it."""
        return list(broadcasts(self.recording))

    @cached_property
    def fates(self) -> Fates:
        """As History has it."""
        return fates_of(self.broadcasts)

    @cached_property
    def conditions(self) -> list[ConditionChange]:
        """As History has it."""
        faults, found = FaultState(self.swarm.names), []
        for command in self.recording.commands:
            if (i := faults.obey(command)) is not None:
                found.append(ConditionChange(command.t, i, faults.condition[i]))
        return found

    def agent(self, i: int) -> AgentSeries:
        """As History has it."""
        return self._agents[i]

    @cached_property
    def _agents(self) -> list[AgentSeries]:
        inputs = [len(member.dynamics.inputs) for member in self.swarm.members]
        return [recorded_series(s, m) for s, m in zip(self.steps, inputs, strict=True)]


def recorded_history(recording: Recording) -> RecordedHistory:
    """The past of a recording. Raises ScenarioError if its scenario cannot be built."""
    return RecordedHistory(recording, SafetyValues(build_rows(build_swarm(recording.scenario))))


def smallest_distance(swarm: Swarm, positions: Array) -> float:
    """The smallest distance of a normal agent from any other [m]; infinite if it is alone."""
    normal = np.array(swarm.normal)
    distances = cdist(positions[normal], positions)
    distances[np.arange(len(normal)), normal] = np.inf  # its own
    return float(distances.min())
