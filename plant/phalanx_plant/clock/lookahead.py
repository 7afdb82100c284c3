"""Lookahead: integrate beyond inputs that have not arrived, while no sample depends on them.

No agent's motion depends on another's, so the states of agents that have answered are known however
long others take. An agent that has not answered is within the distance that its dynamics let it
travel. While that is outside another agent's sensing radius, it does not affect that one's sample.
"""

import math
from collections import deque
from collections.abc import Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.models.dynamics import Bounded
from phalanx_plant.clock.lockstep import Sequential
from phalanx_plant.sampling.sensing import sensing_radii
from phalanx_plant.world.world import Piece, RungeKutta, Segment, World

_SLACK = 1e-6
"""Allowance for integration and rounding errors [m]."""
_MOST_UNKNOWN = 8
"""Pending inputs before the plant waits for the oldest: enough for the cores of a host, and few to
integrate again when they arrive."""


class _Unknown(NamedTuple):
    """An agent whose input is pending, at the instant from which that counts."""

    t: float
    """[s]"""
    x: Array
    """shape (n_i,)"""
    p: Array
    """Output position [m]."""
    u: Array
    """The input that its actuator held until then, shape (m_i,)."""
    since: int
    """Number of the first piece of the history after it."""


class Lookahead(Sequential):
    """The world's integration, ahead of the world: NaN where the state is not known."""

    sequential = False

    def __init__(self, world: World, radii: Array) -> None:
        """Run ahead of a world that follows.

        Args:
            world: at x(0). No disturbance may depend on the state.
            radii: sensing radius of each agent [m].
        """
        swarm, self._world = world.swarm, world
        self._integration, self._radii = world.integration, radii
        self._parts = swarm.safe_set.parts
        dynamics = [m.dynamics for m in swarm.members]
        self._bounded = [d if isinstance(d, Bounded) else None for d in dynamics]
        self._bounds = [group.disturbance.bound for group in swarm.groups]
        self._unknown: dict[int, _Unknown] = {}
        self._ahead: deque[Piece] = deque()
        """The history ahead of the world."""
        self._first_ahead = 0
        """Number of the first piece of it."""

    @property
    def unknown(self) -> list[int]:
        """Agents whose inputs are pending, the oldest first."""
        return list(self._unknown)

    def begin_unknown(self, i: int) -> None:
        """Integrate agent i as NaN until its input is known."""
        now = self._integration
        x, p = now.x[self._parts[i]].copy(), now.p[i].copy()
        self._unknown[i] = _Unknown(now.t, x, p, now.held(i), self._first_ahead + len(self._ahead))
        now.hold(i, np.nan)

    def end_unknown(self, i: int, u: Array | None) -> None:
        """Integrate agent i again from where its input, now known, took effect."""
        begun, part = self._unknown.pop(i), self._parts[i]
        held, x = begun.u if u is None else u, begun.x
        self._integration.hold(i, held)
        for piece in islice(self._ahead, begun.since - self._first_ahead, None):
            if isinstance(piece, Segment):
                # The last one shares its arrays with the integration's state.
                # So does the next one's start.
                phi, slope = piece.phi[part], piece.slope[part]
                piece.u[self._integration.inputs[i]] = held
                piece.x[:, part], piece.p[:, i] = self._integration.motion.one_agent(
                    i, len(piece.x), x, held, phi, slope, piece.dt
                )
                x = piece.x[-1, part]

    def advance(self, until: float) -> None:
        """Integrate ahead to `until` [s]."""
        self._ahead.extend(self._integration.integrate(until))

    def reach(self, until: float) -> None:
        """Let the world follow to `until` [s]: all inputs that take effect before are known."""
        self.advance(until)
        ahead, passed = self._ahead, list[Piece]()
        while ahead and ahead[0].t < until:
            passed.append(ahead.popleft())
        self._first_ahead += len(passed)
        self._world.follow(passed)

    def required(self, sampling: Sequence[int]) -> list[int]:
        """Return agents whose inputs must be known before those in `sampling` are sampled.

        If one of these is itself required, more may be required once it is known. If too many
        inputs are pending, the oldest are required.
        """
        visible = [i for i in self._unknown if any(self._may_see(j, i) for j in sampling)]
        return visible or self.unknown[:-_MOST_UNKNOWN]

    def _may_see(self, j: int, i: int) -> bool:
        if j in self._unknown:
            return i == j  # the position of j is known only after its own input
        dynamics, begun, now = self._bounded[i], self._unknown[i], self._integration
        if dynamics is None:
            return True
        farthest = dynamics.travel(begun.x, now.t - begun.t, self._bounds[i])
        return not math.dist(now.p[j], begun.p) > self._radii[j] + farthest + _SLACK


def look_ahead(world: World) -> Sequential:
    """Choose lookahead, or sequential synchronization if lookahead cannot save time.

    A sample that sees all agents waits for all of them: lookahead needs most to see fewer.
    """
    swarm, radii = world.swarm, sensing_radii(world.swarm)
    limited = 2 * np.isfinite(radii).sum() > len(radii)
    adverse = any(group.disturbance.kind == "adverse" for group in swarm.groups)
    drawn = isinstance(world.integration, RungeKutta)
    unknown = swarm.by_radio or adverse  # by radio the distances to all are in a sample
    if swarm.time.lookahead and drawn and limited and not unknown:
        return Lookahead(world, radii)
    return Sequential(world)
