"""The disturbances that explain a recorded run, input by input."""

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.disturbance_ledger import DisturbanceLedger
from phalanx.recording.read import Recording, steps_by_agent
from phalanx.recording.records import Step
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.dynamics import Dynamics


class AgentDisturbances(NamedTuple):
    """Disturbances that explain one agent's motion, for each of w intervals between its inputs."""

    t: Array
    """Begin of each interval [s], shape (w,)."""
    seconds: Array
    """Length of each [s], shape (w,)."""
    phi: Array
    """The constant disturbance that explains it, shape (w, n)."""
    size: Array
    """Its norm, rounded up; infinite where none explains it, shape (w,)."""
    speed: Array
    """Mean speed of the output point along its chord [m/s], shape (w,)."""
    input: Array
    """Norm of the input, shape (w,)."""


def disturbances_of(recording: Recording, swarm: Swarm) -> list[AgentDisturbances]:
    """Explain the motion of every agent of a recorded run.

    An interval in which an input took effect in a state that is not recorded is left out.
    """
    times = recording.times
    x = recording.x.reshape(len(times), swarm.safe_set.parts[-1].stop)
    by_dynamics = dict[int, _Explained]()
    disturbances = []
    agents = zip(
        swarm.members, swarm.safe_set.parts, steps_by_agent(recording).values(), strict=True
    )
    for member, part, steps in agents:
        explained = by_dynamics.setdefault(id(member.dynamics), _Explained(member.dynamics))
        disturbances.append(explained.intervals(times, x[:, part], steps))
    return disturbances


class _Explained:
    """Intervals of agents with one dynamics."""

    def __init__(self, dynamics: Dynamics) -> None:
        self._ledger, self._inputs = DisturbanceLedger(dynamics), len(dynamics.inputs)
        state = ca.SX.sym("x", len(dynamics.states))
        self._position = MappedFunction([state], [dynamics.position(state)])

    def intervals(self, times: Array, x: Array, steps: Sequence[Step]) -> AgentDisturbances:
        """Explain an agent's states x, shape (s, n), at these times, shape (s,)."""
        applied = np.array([step.t_apply for step in steps])
        order = np.argsort(applied, kind="stable")
        inputs = np.array([steps[k].u for k in order]).reshape(-1, self._inputs)
        # Every actuator holds zero before its first input.
        inputs, applied = np.vstack([np.zeros((1, self._inputs)), inputs]), applied[order]
        begin, end = _constant(times, applied)
        in_force = inputs[np.searchsorted(applied, times[begin], side="right")]
        seconds, before, after = times[end] - times[begin], x[begin], x[end]
        phi, size = self._ledger.explain(before, after, in_force, seconds)
        moved = self._at(after) - self._at(before)
        return AgentDisturbances(
            times[begin], seconds, phi, size, length(moved) / seconds, length(in_force)
        )

    def _at(self, x: Array) -> Array:
        return self._position(x.ravel(), np.arange(x.size).reshape(x.shape))


def _constant(times: Array, applied: Array) -> tuple[Index, Index]:
    """Return the first and last state of each interval between inputs, as indices, (w,) each."""
    recorded = applied[np.isin(applied, times)]
    if not len(times):
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    ends = np.unique(np.concatenate([times[:1], recorded, times[-1:]]))
    cuts = np.searchsorted(times, ends)
    missing = np.setdiff1d(applied, times)
    inside = np.diff(np.searchsorted(missing, ends)) > 0
    return cuts[:-1][~inside], cuts[1:][~inside]
