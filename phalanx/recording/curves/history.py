"""The past of a run as arrays."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.distance import cdist

from phalanx.faults.commands import Condition, FaultState
from phalanx.messages.step_report import QUANTITIES, numbers_of
from phalanx.recording.curves.values import SafetyValues
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.rows.origin import Origin
from phalanx.theory.safety.composition import Pair

EMPTY_CODES: dict[str, float] = {Origin.BACKUP: 1.0, Origin.NO_AUTHORITY: 2.0}
"""Codes of steps with empty K_i in AgentSeries.empty, by how their input was made."""
IN_TIME, LATE, LOST = FATES = ("in time", "late", "lost")
"""In time: for the receiver's next step after it was sent."""
_PAIR_STATES, _PAIR_VALUES = 400, 2_000_000


class AgentSeries(NamedTuple):
    """One agent's control steps; NaN where something is not known."""

    t: Array
    """When the inputs were applied [s], shape (s,)."""
    sampled: Array
    """When the samples were taken [s]; of a live run, as t."""
    empty: Array
    """A code of EMPTY_CODES where K_i was empty; else 0."""
    numbers: dict[str, Array]
    """By their names in QUANTITIES."""
    u: Array
    """Applied inputs, shape (s, m_i)."""
    u_nom: Array
    """Nominal inputs, shape (s, m_i)."""


def series_width(inputs: int) -> int:
    """Number of columns in the rows of agent_series, for an agent with so many inputs."""
    return 2 + len(QUANTITIES) + 2 * inputs


def agent_series(rows: Array, sampled: Array | None = None) -> AgentSeries:
    """Split rows of t, empty, the numbers, u and u_nom, shape (s, series_width(m_i))."""
    t, empty, *values = rows[:, : series_width(0)].T
    u, u_nom = np.hsplit(rows[:, series_width(0) :], 2)
    numbers = dict(zip(QUANTITIES, values, strict=True))
    return AgentSeries(t, t if sampled is None else sampled, empty, numbers, u, u_nom)


def recorded_series(steps: Sequence[Step], inputs: int) -> AgentSeries:
    """An agent's recorded steps; `inputs` is m_i."""
    unknown = [None] * inputs  # NumPy makes NaN of None
    rows = [
        [s.t_apply, EMPTY_CODES.get(s.origin, 0.0), *numbers_of(s), *s.u, *(s.u_nom or unknown)]
        for s in steps
    ]
    values = np.array(rows, dtype=float).reshape(-1, series_width(inputs))
    return agent_series(values, np.array([s.t for s in steps]))


class PairSeries(NamedTuple):
    """h of every pair; -inf once no normal agent is left in it."""

    t: Array
    """[s], shape (s,)."""
    h: Array
    """Shape (s, p), in the order of the composed set's pairs."""


def pair_states(pairs: int, most: int) -> int:
    """Number of states, up to `most`, at which h of all pairs is computed: it is expensive."""
    return max(min(most, _PAIR_VALUES // max(pairs, 1)), 1)


class Fates(NamedTuple):
    """Counts of broadcasts that were late or lost; a row is one broadcast, or several to one agent.

    All of shape (b,).
    """

    t: Array
    """When they were sent [s]."""
    receiver: Array
    total: Array
    late: Array
    lost: Array


BROADCAST = np.dtype(
    [("sender", "i4"), ("receiver", "i4"), ("sent", "f8"), ("arrival", "f8"), ("fate", "i1"),
     ("false", "?")]
)  # fmt: skip
"""One broadcast on one link: sender and receiver by index; when it was sent and arrived [s], which
are equal if it was lost; its fate, by index in FATES; and whether its content was false."""


def broadcasts(recording: Recording) -> np.recarray:
    """Every broadcast whose fate a receiver decided, and whose sender's step is recorded."""
    # As an array, which takes a tenth of the memory of tuples.
    return np.fromiter(_broadcasts(recording), BROADCAST).view(np.recarray)


def _broadcasts(recording: Recording) -> Iterator[tuple[int, int, float, float, int, bool]]:
    index = {name: i for i, (name, _, _) in enumerate(recording.scenario.roster())}
    # A broadcast is put when its input takes effect; delays count from there.
    latency = recording.scenario.time.latency
    sent_at = {(step.agent, step.k): step.t + latency for step in recording.steps}
    of_agents = steps_by_agent(recording).items()
    # In lists: for a single number bisect takes a fifth of NumPy's time.
    samples = {name: [*(s.t for s in steps), np.inf] for name, steps in of_agents}
    for step in recording.steps:
        false = {(sender, k) for sender, k, *_ in step.false}
        for sender, k, delay in step.fates:
            if (t := sent_at.get((sender, k))) is None:
                continue
            due = samples[step.agent]
            late = t + delay > due[bisect_right(due, t)]
            fate = FATES.index(LOST if delay < 0.0 else LATE if late else IN_TIME)
            arrival = t + max(delay, 0.0)
            yield index[sender], index[step.agent], t, arrival, fate, (sender, k) in false


def fates_of(broadcasts: np.recarray) -> Fates:
    """Count each of these broadcasts, of dtype BROADCAST, in a row of its own."""
    late, lost = (broadcasts.fate == FATES.index(fate) for fate in (LATE, LOST))
    return Fates(broadcasts.sent, broadcasts.receiver, np.ones(len(broadcasts)), late, lost)


class ConditionChange(NamedTuple):
    """A change of an agent's condition."""

    t: float
    """[s]"""
    agent: int
    condition: Condition


class History(Protocol):
    """The past of a run, recorded or live."""

    broadcasts: np.recarray
    """Every broadcast of a recorded run, of dtype BROADCAST; empty for a live one."""
    conditions: Sequence[ConditionChange]
    """In order; every agent is fine at first."""

    @property
    def totals(self) -> Array:
        """t, h_tot, the largest h of a pair with a normal agent, the smallest distance, ψ_1 ...
        ψ_{q-1}: a row for each state."""

    @property
    def pairs(self) -> PairSeries:
        """h of every pair at some of the times of `totals`, the worst ones among them."""

    @property
    def fates(self) -> Fates:
        """Fates of all broadcasts; none for a live run with many agents."""

    def agent(self, i: int) -> AgentSeries:
        """Agent i's control steps."""


class RecordedHistory(History):
    """The past of a recording; holds arrays alone, so that the recording itself can be freed."""

    def __init__(self, recording: Recording, values: SafetyValues) -> None:
        self.scenario, self.values, self.swarm = recording.scenario, values, values.rows.swarm
        self.times, self.x = recording.times, recording.x
        self.h_tot, self.h = recording.h_tot, recording.h
        """Of the states, shapes (s,), (s, n̄), (s,) and (s,)."""
        self.broadcasts = broadcasts(recording)
        self.conditions = _condition_changes(recording)
        self._turns = recording.turns
        self._agents = [
            recorded_series(steps, len(member.dynamics.inputs))
            for steps, member in zip(
                steps_by_agent(recording).values(), self.swarm.members, strict=True
            )
        ]

    @property
    def worst(self) -> int:
        """Index of the state with the largest h of a pair with a normal agent."""
        return int(np.argmax(self.h))

    @cached_property
    def worst_pair(self) -> Pair:
        """The pair with that h; needs a state."""
        turned = self._turned_by(float(self.times[self.worst]))
        return self.swarm.safe_set.pairs[self.values.worst_pair(self.x[self.worst], turned)]

    def _turned_by(self, t: float) -> list[int]:
        """Agents that had turned adversary by t [s]."""
        return [i for i, at in self._turns.items() if at <= t]

    @cached_property
    def trajectory(self) -> Array:
        """Output points in space [m], shape (s, N, 3); z = 0 in the plane."""
        points = np.zeros((len(self.x), len(self.swarm.names), 3))
        for state, x in enumerate(self.x):
            positions = self.swarm.positions(x)
            points[state, :, : positions.shape[1]] = positions
        return points

    @property
    def positions(self) -> Array:
        """Output points [m], shape (s, N, 2) or (s, N, 3)."""
        return self.trajectory[:, :, : self.swarm.safe_set.positions[0].numel()]

    def distance(self, pair: Pair) -> Array:
        """Distance between a pair's output points, or from a center, a wall or a box [m], (s,).

        0 from a limit, which is everywhere.
        """
        points = self.positions[:, pair.a]
        if (obstacle := pair.b - len(self.swarm.members)) >= 0:
            return self.scenario.static[obstacle].distances(points)
        between: Array = np.linalg.norm(points - self.positions[:, pair.b], axis=1)
        return between

    @cached_property
    def totals(self) -> Array:
        distances = [smallest_distance(self.swarm, p) for p in self.positions]
        psi = np.array([self.values.higher_psi(x) for x in self.x])
        return np.column_stack([self.times, self.h_tot, self.h, distances, psi])

    @cached_property
    def pairs(self) -> PairSeries:
        """h at the worst state of each block of time: at all states there would be too many."""
        count = pair_states(len(self.swarm.safe_set.pairs), min(_PAIR_STATES, len(self.times)))
        blocks = np.array_split(np.arange(len(self.times)), count)
        worst = [block[int(np.argmax(self.h[block]))] for block in blocks]
        # One state at a time: for several at once it takes half as much memory again.
        states = zip(self.x[worst], self.times[worst].tolist(), strict=True)
        h = np.array([self.values.every_h(x, self._turned_by(t)) for x, t in states])
        return PairSeries(self.times[worst], h)

    @property
    def fates(self) -> Fates:
        return fates_of(self.broadcasts)

    def agent(self, i: int) -> AgentSeries:
        return self._agents[i]


def _condition_changes(recording: Recording) -> list[ConditionChange]:
    faults = FaultState(tuple(name for name, _, _ in recording.scenario.roster()))
    changes = []
    for command in recording.commands:
        if (i := faults.apply(command)) is not None:
            changes.append(ConditionChange(command.t, i, faults.condition[i]))
    return changes


def smallest_distance(swarm: Swarm, positions: Array) -> float:
    """Smallest distance of a normal agent from any other [m]; infinite if it is alone."""
    normal = np.array(swarm.normal)
    distances = cdist(positions[normal], positions)
    distances[np.arange(len(normal)), normal] = np.inf  # its own
    return float(distances.min())


class ReportHistory(RecordedHistory):
    """The past of a recording, with its records."""

    def __init__(self, recording: Recording, values: SafetyValues | None = None) -> None:
        """Build the recorded scenario's rows unless `values` are given. Raises ScenarioError."""
        super().__init__(
            recording, values or SafetyValues(build_rows(build_swarm(recording.scenario)))
        )
        self.recording = recording
        self.steps = list(steps_by_agent(recording).values())
        """Recorded control steps of each agent."""
