"""Inputs held by actuators in a recording, and the instants without a certificate."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.safety.composition import Member
from phalanx_certify.checker.intervals import UncertifiableError, UndecidedError


class StateRecord(Protocol):
    """The true state at an event: a sample taken or an input applied."""

    t: float
    x: list[float]


class StepRecord(Protocol):
    """An input that took effect at t_apply."""

    agent: str
    t_apply: float
    u: tuple[float, ...]


class HeldInputs(NamedTuple):
    """The inputs that one agent's actuator held, in order."""

    t: Array
    """Begin of each [s], shape (s,)."""
    until: Array
    """End of each [s], shape (s,)."""
    u: Array
    """shape (m, s)"""


def track(states: Sequence[StateRecord], n: int) -> tuple[Array, Array]:
    """Times, shape (e,), and states, shape (n, e). Raises UncertifiableError."""
    if not states or any(len(state.x) != n for state in states):
        raise UncertifiableError(f"expected states of {n} components")
    times = np.array([s.t for s in states])
    x = np.empty((n, len(states)))
    for k, state in enumerate(states):
        x[:, k] = state.x
    if times[0] < 0.0 or not (np.diff(times) >= 0.0).all() or not np.isfinite(x).all():
        raise UncertifiableError("expected finite states in order from t = 0 on")
    return times, x


def inputs_of(
    members: Sequence[Member], times: Array, steps: Sequence[StepRecord]
) -> list[HeldInputs]:
    """Return the inputs that each member's actuator held: zeros until the first.

    Raises UncertifiableError, or UndecidedError where states are missing.
    """
    of: dict[str, list[StepRecord]] = {member.name: [] for member in members}
    for step in steps:
        of[step.agent].append(step)
    return [_held(member, times, of[member.name]) for member in members]


def _held(member: Member, times: Array, steps: Sequence[StepRecord]) -> HeldInputs:
    m = len(member.dynamics.inputs)
    ordered = sorted(steps, key=lambda step: step.t_apply)
    if any(len(step.u) != m for step in ordered):
        raise UncertifiableError(f"expected inputs of {m} components of agent {member.name}")
    t, u = [step.t_apply for step in ordered], [step.u for step in ordered]
    if not t or t[0] > times[0]:
        t, u = [float(times[0]), *t], [(0.0,) * m, *u]
    since = np.array(t)
    if not np.isin(since, times).all():
        raise UndecidedError(
            f"agent {member.name} applied an input in a state not recorded: record one at every "
            "event, time.recording_step = 0"
        )
    return HeldInputs(since, np.append(since[1:], times[-1]), np.array(u).reshape(-1, m).T)


class Inputs:
    """The inputs of all agents in one array, agent by agent."""

    def __init__(self, times: Array, held: Sequence[HeldInputs]) -> None:
        """Concatenate inputs; `times` are those of the recorded states [s]."""
        self.t = np.concatenate([h.t for h in held])
        self.until = np.concatenate([h.until for h in held])
        self.state: Index = np.searchsorted(times, self.t)
        """Index of the recorded state in which each took effect."""
        self.u = np.zeros((max(len(h.u) for h in held), len(self.t)))
        """A column for each, filled up with zeros."""
        self.count: Index = np.array([len(h.t) for h in held])
        """Number of inputs of each agent."""
        self.first: Index = np.cumsum(self.count) - self.count
        """Index of each agent's first input."""
        for h, first in zip(held, self.first.tolist(), strict=True):
            self.u[: len(h.u), first : first + len(h.t)] = h.u

    def of(self, agents: Index, most: int) -> Iterator[tuple[Index, Index]]:
        """Yield all inputs of these agents, up to `most` at once: index in `agents`, and input."""
        end = np.cumsum(self.count[agents])
        before = end - self.count[agents]
        for begin in range(0, int(end[-1]), most):
            number = np.arange(begin, min(begin + most, int(end[-1])))
            which = np.searchsorted(end, number, side="right")
            yield which, self.first[agents[which]] + number - before[which]


class _Gaps(NamedTuple):
    """Time intervals in which no input of an agent certifies a pair."""

    pair: Index
    begin: Array
    """[s]"""
    end: Array
    """[s]"""

    def of(self, pair: int) -> Array:
        """Beginnings and ends of one pair's, shape (2, r); the pairs are in order."""
        own = slice(*np.searchsorted(self.pair, (pair, pair + 1)).tolist())
        return np.stack([self.begin[own], self.end[own]])


_NONE = _Gaps(np.zeros(0, np.intp), np.zeros(0), np.zeros(0))


class Coverage:
    """Accumulates the certificates of all inputs; covered intervals are not kept."""

    def __init__(self, inputs: Inputs, counted: Mask) -> None:
        """Begin without certificates; `counted` are the inputs of agents that were normal then."""
        self._inputs, self._counted = inputs, counted
        self.lasting: Mask = np.ones(len(inputs.t), dtype=bool)
        """Inputs whose certificates of all pairs so far last until the next input."""
        self.horizon = np.inf
        """The shortest certificate so far [s]."""
        self._gaps: tuple[list[_Gaps], list[_Gaps]] = ([_NONE], [_NONE])
        """By the agent's side in the pair."""

    def add(self, side: int, pairs: Index, k: Index, horizons: Array) -> None:
        """Add the certified times of pairs [s] after the agent at `side` applies input k, (s,)."""
        t, until = self._inputs.t[k], self._inputs.until[k]
        # Rounded down: no instant beyond the bound counts.
        end = np.minimum(np.nextafter(t + horizons, -np.inf), until)
        short = end < until
        self.lasting[k[short]] = False
        counted = horizons[self._counted[k]]
        self.horizon = min(self.horizon, float(counted.min(initial=np.inf)))
        gaps = _Gaps(pairs[short], np.maximum(t, end)[short], until[short])
        self._gaps[side].append(gaps)

    def first_uncovered(self, shared: Mask, until: Array) -> tuple[float, int] | None:
        """Return the first uncovered instant [s] and its pair.

        shared: pairs that either member's certificates cover; until: time until which each pair
        needs one [s], shapes (p,).
        """
        first, second = map(_in_order, self._gaps)
        uncovered = []
        for pair in np.unique(first.pair).tolist():
            other = second.of(pair) if shared[pair] else _ALWAYS
            uncovered += [(t, pair) for t in _first_shared(first.of(pair), other)]
        return min(((t, pair) for t, pair in uncovered if t < until[pair]), default=None)


_ALWAYS = np.array([[-np.inf], [np.inf]])


def _in_order(parts: Sequence[_Gaps]) -> _Gaps:
    pair, begin, end = (np.concatenate(each) for each in zip(*parts, strict=True))
    order = np.lexsort((begin, pair))
    order = order[begin[order] < end[order]]
    return _Gaps(pair[order], begin[order], end[order])


def _first_shared(a: Array, b: Array) -> list[float]:
    """Return the first instant in gaps of both, if any; each is sorted and disjoint."""
    after = np.searchsorted(b[1], a[0], side="right")
    some = after < b.shape[1]
    begin = np.maximum(a[0][some], b[0][after[some]])
    instants: list[float] = begin[begin < a[1][some]][:1].tolist()
    return instants
