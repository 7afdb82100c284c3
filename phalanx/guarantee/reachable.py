"""Reachable boxes of all agents, which show the pairs that are too far apart to meet.

In swarms of hundreds, an agent's certificates are then evaluated for its neighbours alone.
"""

from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.certificate import MULTIPLES, reach_within
from phalanx.swarm.swarm import DEFECT, Swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import dot
from phalanx.theory.expressions.extension import extend
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import scalars
from phalanx.theory.safety.function import Reaching, static_reach
from phalanx.theory.safety.obstacles import Sphere

_LASTING = 0.5
"""Time for which boxes are reused, in τ; they cover a certificate's longest horizon after it."""


class _Group(NamedTuple):
    """Agents of one group."""

    members: Index
    states: Index
    """Indices of their states in x, shape (r, n)."""
    box: MappedFunction | None
    """x -> least and largest of each component of p; None if unknown."""


class ReachableBoxes:
    """The boxes of all agents and obstacles, recomputed when they are too old."""

    def __init__(self, swarm: Swarm, function: Reaching) -> None:
        scenario, members = swarm.scenario, swarm.members
        tau = swarm.longest_horizon
        self._lasting = _LASTING * tau
        self._until = -np.inf
        axes, count = scenario.agents[0].axes, len(members) + len(scenario.static)
        self._axes = axes
        self._low, self._high = np.full((count, axes), -np.inf), np.full((count, axes), np.inf)
        self._reach = np.full(count, function.reach(0.0))
        for k, obstacle in enumerate(scenario.static, start=len(members)):
            self._reach[k] = static_reach(function, 0.0, obstacle)
            if isinstance(obstacle, Sphere):
                self._low[k] = self._high[k] = obstacle.center
        self._groups = []
        for number, group in enumerate(scenario.agents):
            agents = np.array([i for i, other in enumerate(swarm.groups) if other is group])
            horizon = MULTIPLES[0] * tau + self._lasting
            states = np.array([np.r_[swarm.safe_set.parts[i]] for i in agents])
            bound = group.disturbance.bound + DEFECT
            compiled = partial(_box, swarm, int(agents[0]), bound, horizon)
            box = swarm.functions.get(("reachable box", number, horizon), compiled)
            self._groups.append(_Group(agents, states, box))

    def near(self, i: Index, others: Index, inputs: Index, t: Array, x: Array) -> Mask:
        """Return which pairs may meet within a certificate's longest horizon, shape (q,).

        Args:
            i: their agents, shape (q,).
            others: members, or N + k for obstacle k, shape (q,).
            inputs: the row of each in t and x, shape (q,).
            t: times [s], in order, and not before those of the last call; shape (r,).
            x: true stacked states then, shape (r, n̄).
        """
        renewed, row = list[int](), 0
        while (row := row + int(np.searchsorted(t[row:], self._until, side="right"))) < len(t):
            self._until = float(t[row]) + self._lasting
            renewed.append(row)
        low, high = (np.tile(ends, (1 + len(renewed), 1, 1)) for ends in (self._low, self._high))
        for group in self._groups if renewed else ():
            if group.box is not None:
                box = group.box(x[renewed], group.states)
                low[1:, group.members] = box[..., : self._axes]
                high[1:, group.members] = box[..., self._axes :]
        self._low, self._high = low[-1], high[-1]
        of = np.searchsorted(renewed, inputs, side="right")
        apart = np.maximum(low[of, others] - high[of, i], low[of, i] - high[of, others])
        gap, reach = np.maximum(0.0, apart), self._reach[others]
        # NaN counts as near.
        near: Mask = ~(dot(gap, gap) > reach * reach)
        return near


@outwards()
def _box(swarm: Swarm, i: int, bound: float, horizon: float) -> MappedFunction | None:
    """Compile x_i -> least and largest p_i within the horizon; None if there is no bound."""
    member = swarm.members[i]
    x = ca.SX.sym("x", len(member.dynamics.states))
    try:
        reach = reach_within(member, x, bound, horizon)
        p = ca.vertsplit(member.dynamics.position(x))
        components = extend(p, scalars([x]), reach.states)
    except ValueError:
        return None
    low = [ca.if_else(reach.certain, p_k.lo, -ca.inf) for p_k in components]
    high = [ca.if_else(reach.certain, p_k.hi, ca.inf) for p_k in components]
    return MappedFunction([x], [ca.vertcat(*low, *high)])
