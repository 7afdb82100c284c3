"""Deadlock: an agent that wants to move, is held by its rows, and waits in one place.

It does so by its inputs and positions alone, whether it has a goal or not. The plant watches a run
and writes each deadlock into the recording; with other limits a recording is watched again.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.verdict import Deadlock
from phalanx.recording.columns import Inputs, States, last_before
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.polytope import Polytope, constant_polytope
from phalanx.theory.rows.qp import NearestInput

STILL = 0.25
"""An agent stands while its output point, and how far the nearest other is, change less [m]."""
_SAMPLES = 50
"""Times at which an agent's patience is looked at."""
_WISHES = 0.1
"""Share of an agent's largest input from which a wish is one to move, and a row holds it."""
_LASTS = 2.0
"""How many of its longest periods an agent's wish lasts: one that died wants nothing, though its
actuator holds its last input."""


def usual_patience(duration: float) -> float:
    """Return the time after which one that stands is in deadlock, in a run so long [s]."""
    return min(5.0, 0.2 * duration)


class Wishes:
    """Agents' wishes to move, and whether their rows let them."""

    def __init__(self, swarm: Swarm) -> None:
        dynamics = [m.dynamics for m in swarm.members]
        # Agents with the same dynamics have the same inputs.
        self._first = [[id(d) for d in dynamics].index(id(d)) for d in dynamics]
        self._inputs, self._nearest = dict[int, Polytope | None](), dict[int, NearestInput]()
        self._sizes = [len(d.inputs) for d in dynamics]
        self._largest = np.zeros(len(dynamics))
        """Size of each agent's largest input; of one so far where U depends on the state."""
        for i in {*self._first}:
            x = ca.SX.sym("x", len(dynamics[i].states))
            inputs = self._inputs[i] = constant_polytope(*dynamics[i].input_polytope(x))
            self._nearest[i] = NearestInput(dynamics[i].input_metric())
            if inputs is not None:
                same = [l for l, first in enumerate(self._first) if first == i]
                self._largest[same] = float(length(inputs.corners).max())

    def held(self, i: Index, u: Array, u_nom: Array) -> Mask:
        """Return whether the nearest input to each wish is one to move, and another than u.

        i: agents, shape (r,). u, u_nom: inputs and wishes, NaN if not known, padded, (r, m).
        """
        held: Mask = (u != u_nom).any(axis=1) & ~np.isnan(u_nom).any(axis=1)
        some = np.flatnonzero(held)
        group = np.array(self._first)[i[some]]
        for first in np.unique(group).tolist():
            rows = some[group == first]
            held[rows] = self._hold(first, i[rows], u[rows], u_nom[rows])
        return held

    def _hold(self, first: int, i: Index, u: Array, wishes: Array) -> Mask:
        """The same of agents with one dynamics."""
        inputs, size = self._inputs[first], self._sizes[first]
        u, wishes = u[:, :size], wishes[:, :size]
        if inputs is None:
            largest = length(u)
            for n, agent in enumerate(i.tolist()):
                largest[n] = self._largest[agent] = max(self._largest[agent], largest[n])
        elif inputs.box is None:
            largest = self._largest[i]
            near = [self._nearest[first].solve(wish, inputs) for wish in wishes]
            wishes = np.array([u[n] if v is None else v for n, v in enumerate(near)])
        else:
            largest, wishes = self._largest[i], inputs.box.nearest(wishes)
        held: Mask = np.minimum(length(wishes), length(u - wishes)) > _WISHES * largest
        return held


class _Sample(NamedTuple):
    t: float
    p: Array
    """Output points of all agents [m], shape (N, d)."""
    held: Array
    """For how long each agent was held so far [s], shape (N,); 0 of an adversary."""
    binding: Mapping[int, tuple[int, ...]]
    """Whose rows hold each normal agent at that instant."""


class DeadlockWatch:
    """A fold over the states and inputs of a run that finds deadlocks as they begin.

    An agent is in deadlock once, for as long as its patience, its output point and the distance to
    the nearest other stay within `still`, while its wish is held for most of that time.
    """

    def __init__(self, swarm: Swarm, still: float = STILL, patience: float | None = None) -> None:
        """still: [m]. patience: [s]; by default as usual for the scenario's duration."""
        self._swarm, self._still = swarm, still
        self._patience = patience or usual_patience(swarm.scenario.duration)
        self._wishes, count = Wishes(swarm), len(swarm.names)
        self._normal: Mask = np.isin(np.arange(count), swarm.normal)
        self._lasts = np.array([_LASTS * swarm.horizon(i) for i in range(count)])
        self._held: Mask = np.zeros(count, dtype=bool)
        """Whether each agent's last wish was held, shape (N,)."""
        self._since, self._seconds = np.full(count, -np.inf), np.zeros(count)
        """Times of last inputs [s], and for how long each agent was held until then [s]; (N,)."""
        self._binding: list[tuple[int, ...]] = [() for _ in swarm.names]
        """Whose rows hold each agent, if it is held; as in a StepReport."""
        self._samples, self._due = deque[_Sample](), -np.inf
        self.deadlocks: list[Deadlock] = []
        """All so far, by when they were found."""
        self._last: dict[int, Deadlock] = {}

    def add(self, states: States, inputs: Inputs) -> list[tuple[int, str]]:
        """Take the next states and inputs.

        Returns new deadlocks in words, each with the row of the state that shows it.
        """
        rows = np.flatnonzero(self._normal[inputs.i] & ~inputs.lost)
        i, t, number = inputs.i[rows], inputs.t_apply[rows], inputs.number[rows]
        held = self._wishes.held(i, inputs.u[rows], inputs.u_nom[rows])
        # A wish that was held counts until the agent's next input.
        before = last_before(i, number, i, number)
        was_held = np.where(before >= 0, held[before], self._held[i])
        since = np.where(before >= 0, t[before], self._since[i])
        seconds = np.where(was_held, np.minimum(t - since, self._lasts[i]), 0.0)
        words, first = list[tuple[int, str]](), 0
        for state in self._due_states(states.t.tolist()):
            last = int(np.searchsorted(number, states.number[state]))
            some, first = slice(first, last), last
            self._take(i[some], t[some], held[some], seconds[some], rows[some], inputs)
            now, x = float(states.t[state]), states.x[state]
            words += [(state, str(deadlock)) for deadlock in self._reached(now, x)]
        some = slice(first, None)
        self._take(i[some], t[some], held[some], seconds[some], rows[some], inputs)
        return words

    def _due_states(self, times: Sequence[float]) -> list[int]:
        """Return the states, at these times [s], at which all agents are looked at."""
        due = list[int]()
        for row, t in enumerate(times):
            if t >= self._due:
                self._due = t + self._patience / _SAMPLES
                due.append(row)
        return due

    def _take(
        self, i: Index, t: Array, held: Mask, seconds: Array, rows: Index, inputs: Inputs
    ) -> None:
        """Take inputs, by which their agents were held for so much longer [s], shapes (r,)."""
        np.add.at(self._seconds, i, seconds)
        self._since[i], self._held[i] = t, held
        for agent, row in dict(zip(i.tolist(), rows.tolist(), strict=True)).items():
            if self._held[agent]:
                begin = inputs.bindings[row - 1] if row else 0
                self._binding[agent] = tuple(inputs.binding[begin : inputs.bindings[row]].tolist())

    def held_for(self, t: float) -> Array:
        """Return for how long each agent was held until t [s], shape (N,); 0 of an adversary."""
        lasting = np.where(self._held, np.minimum(t - self._since, self._lasts), 0.0)
        return self._seconds + lasting

    def _reached(self, t: float, x: Array) -> list[Deadlock]:
        """Take the stacked state x at t [s], shape (n̄,), and return the deadlocks that it shows."""
        swarm, samples, held = self._swarm, self._samples, self.held_for(t)
        binding = {i: self._binding[i] if self._held[i] else () for i in swarm.normal}
        samples.append(_Sample(t, swarm.positions(x), held, binding))
        while len(samples) > 1 and samples[1].t <= t - self._patience:
            samples.popleft()
        begin = samples[0].t
        if t - begin < self._patience:
            return []
        for_most = np.flatnonzero(held - samples[0].held > 0.5 * (t - begin))
        standing = [self._waits(i) for i in self._standing(for_most)]
        return [new for new in standing if new is not None]

    def _standing(self, agents: Index) -> list[int]:
        """Return which agents, and the distances to the nearest other, have stayed as they were."""
        if not len(agents):
            return []
        everyone = np.array([sample.p for sample in self._samples])
        moved = length(everyone[:, agents] - everyone[0, agents]).max(axis=0)
        in_place = agents[moved <= self._still].tolist()
        return [i for i in in_place if self._has_company(i, everyone)]

    def _has_company(self, i: int, everyone: Array) -> bool:
        """True if the distance to the nearest other stays; everyone: positions, (s, N, d)."""
        positions = everyone[:, i]
        distances = length(everyone - positions[:, None])
        distances[:, i] = np.inf
        statics = [o.distances(positions) - o.clearance for o in self._swarm.scenario.obstacles]
        nearest = np.column_stack([distances, *statics]).min(axis=1)
        return bool(np.ptp(np.where(np.isfinite(nearest), nearest, 0.0)) <= self._still)

    def _waits(self, i: int) -> Deadlock | None:
        """Begin a deadlock of agent i, or go on with its last one; return a new one."""
        begin, now, last = self._samples[0].t, self._samples[-1].t, self._last.get(i)
        if last is None or last.end < begin:
            new = Deadlock(self._swarm.names[i], begin, now)
            self._last[i] = new
            self.deadlocks.append(new)
            after = begin
        else:
            new, after = None, last.end
            last.end = now
        labels, deadlock = self._swarm.safe_set.labels, self._last[i]
        for before, sample in pairwise(self._samples):
            for l in sample.binding[i] if sample.t > after else ():
                if 0 <= l < len(labels):  # an agent may state anything
                    seconds = deadlock.held_by.get(labels[l], 0.0) + sample.t - before.t
                    deadlock.held_by[labels[l]] = seconds
        return new
