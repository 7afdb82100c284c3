"""Deadlock: an agent that wants to move, is held by its rows, and waits in one place.

It does so by its inputs and positions alone, whether it has a goal or not. The plant watches a run
and writes each deadlock into the recording; with other limits a recording is watched again.
"""

from collections import deque
from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.verdict import Deadlock
from phalanx.messages.step_report import AppliedStep
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.polytope import constant_polytope
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


class HeldWishes:
    """One agent's wishes to move, and for how long its rows have not let it."""

    def __init__(self, swarm: Swarm, i: int) -> None:
        dynamics = swarm.members[i].dynamics
        x = ca.SX.sym("x", len(dynamics.states))
        self._inputs = constant_polytope(*dynamics.input_polytope(x))
        self._nearest = NearestInput(dynamics.input_metric())
        self._largest = 0.0
        """Size of its largest input; of one so far where U depends on the state."""
        if self._inputs is not None:
            self._largest = float(length(self._inputs.corners).max())
        self._lasts, self._since = _LASTS * swarm.horizon(i), -np.inf
        self._seconds = 0.0
        """Until its last input."""
        self.binding: tuple[int, ...] = ()
        """Whose rows hold it; as in a StepReport."""
        self.held = False

    def seconds(self, t: float) -> float:
        """Return for how long it was held until t [s]."""
        return self._seconds + (min(t - self._since, self._lasts) if self.held else 0.0)

    def applied(self, t: float, step: AppliedStep) -> None:
        """Take the input that is in force from t on [s]."""
        self._seconds, self._since = self.seconds(t), t
        self.held = step.u_nom != step.u and self._holds(np.array(step.u), np.array(step.u_nom))
        self.binding = step.binding if self.held else ()

    def _holds(self, u: Array, wish: Array) -> bool:
        """True if the nearest input to the wish is one to move, and another than u."""
        if self._inputs is None:
            self._largest = max(self._largest, float(length(u)))
        else:
            within = self._nearest.solve(wish, self._inputs) if wish.size else None
            wish = u if within is None else within
        return min(float(length(wish)), float(length(u - wish))) > _WISHES * self._largest


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
        self._wishes = {i: HeldWishes(swarm, i) for i in swarm.normal}
        self._samples, self._due = deque[_Sample](), -np.inf
        self.deadlocks: list[Deadlock] = []
        """All so far, by when they were found."""
        self._last: dict[int, Deadlock] = {}

    def applied(self, i: int, t: float, step: AppliedStep) -> None:
        """Take the input that agent i applies from t on [s]."""
        if (wishes := self._wishes.get(i)) is not None:
            wishes.applied(t, step)

    def reached(self, t: float, x: Array) -> list[Deadlock]:
        """Take the stacked state x at t [s], shape (n̄,), and return the deadlocks that it shows."""
        if t < self._due:
            return []
        swarm, samples = self._swarm, self._samples
        self._due = t + self._patience / _SAMPLES
        held = np.zeros(len(swarm.names))
        for i, wishes in self._wishes.items():
            held[i] = wishes.seconds(t)
        binding = {i: wishes.binding for i, wishes in self._wishes.items()}
        samples.append(_Sample(t, swarm.positions(x), held, binding))
        while len(samples) > 1 and samples[1].t <= t - self._patience:
            samples.popleft()
        begin = samples[0].t
        if t - begin < self._patience:
            return []
        for_most = np.flatnonzero(held - samples[0].held > 0.5 * (t - begin)).tolist()
        standing = [self._waits(i) for i in for_most if self._stands(i)]
        return [new for new in standing if new is not None]

    def _stands(self, i: int) -> bool:
        """True if agent i, and the distance to the nearest other, have stayed as they were."""
        positions = np.array([sample.p[i] for sample in self._samples])
        if length(positions - positions[0]).max() > self._still:
            return False
        everyone = np.array([sample.p for sample in self._samples])
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
