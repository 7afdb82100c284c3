"""States ahead of the answers: what is known of the swarm while some inputs are still awaited.

Nobody's motion depends on another's, so that the states of those who have answered are known
however long others take. An agent that has not is somewhere within what its dynamics let it travel:
as long as that is out of another agent's sight, it makes no difference to that agent's sample.
"""

import math
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.theory.models.dynamics import Bounded, travelled
from phalanx_plant.sampling.sensing import sensing_radii
from phalanx_plant.world.world import Passage, Piece, World

_SLACK = 1e-6
"""More than integration and rounding can be off [m]."""
_AT_ONCE = 8
"""How many answers may be awaited at once before the plant waits for the oldest: enough for the
cores of a host, and few to work out anew when they come."""


class _Open(NamedTuple):
    """An agent whose input is awaited, where it was when that took effect."""

    t: float
    """[s]"""
    x: Array
    """shape (n_i,)"""
    p: Array
    """Output position [m]."""
    u: Array
    """What its actuator held until then, shape (m_i,)."""
    since: int
    """Number of the first piece of the way since."""


class Synchronization:
    """Sequential: it waits for all answers, so an input is known as soon as it takes effect."""

    sequential = True
    """Whether all that was handed out is answered before virtual time goes on."""

    def __init__(self, world: World) -> None:
        self._world = world

    @property
    def open(self) -> list[int]:
        """Whose states are not known, since their inputs are awaited; the longest awaited first."""
        return []

    def begin_awaiting(self, i: int) -> None:
        """From now on agent i holds an input that is not known yet: the world stands still."""

    def end_awaiting(self, i: int, u: Array | None) -> None:
        """Agent i's awaited input is u, shape (m_i,).

        None: it was lost, and the actuator holds what it did.
        """
        if u is not None:
            self._world.apply(i, u)

    def in_question(self, who: Sequence[int]) -> list[int]:
        """Agents whose inputs have to be known before those in `who` are sampled."""
        return []

    def advance(self, until: float) -> None:
        """Integrate to `until` [s]. Raises DivergedError."""
        self._world.advance(until)

    def reach(self, until: float) -> None:
        """Bring the world to `until` [s]. Raises DivergedError."""
        self._world.advance(until)


class Lookahead(Synchronization):
    """The world's integration, ahead of the world: NaN where the state is not known."""

    sequential = False

    def __init__(self, world: World, radii: Array) -> None:
        """Go ahead with the integration of a world that follows.

        Args:
            world: at x(0). No disturbance may depend on the state.
            radii: how far each agent sees [m].
        """
        super().__init__(world)
        swarm = world.swarm
        self._integration, self._radii = world.integration, radii
        self._parts = swarm.safe_set.parts
        dynamics = [m.dynamics for m in swarm.members]
        self._bounded = [each if isinstance(each, Bounded) else None for each in dynamics]
        self._bounds = [group.disturbance.bound for group in swarm.groups]
        self._open: dict[int, _Open] = {}
        self._way: deque[Piece] = deque()
        """What the world has not gone yet."""
        self._gone = 0
        """Number of the first piece of it."""

    @property
    def open(self) -> list[int]:
        """Whose inputs are awaited."""
        return list(self._open)

    def begin_awaiting(self, i: int) -> None:
        """From now on agent i holds an input that is not known yet."""
        now = self._integration
        x, p = now.x[self._parts[i]].copy(), now.p[i].copy()
        self._open[i] = _Open(now.t, x, p, now.held(i), self._gone + len(self._way))
        now.hold(i, np.nan)

    def end_awaiting(self, i: int, u: Array | None) -> None:
        """Agent i's awaited input is u, shape (m_i,): its state is known again."""
        begun, own = self._open.pop(i), self._parts[i]
        held, x = begun.u if u is None else u, begun.x
        self._integration.hold(i, held)
        for piece in islice(self._way, begun.since - self._gone, None):
            if isinstance(piece, Passage):
                # The integration's own state is in the last of them.
                # So is the next one's start.
                (count, dt, _), phi, slope = piece.stretch, piece.phi[own], piece.slope[own]
                piece.u[self._integration.inputs[i]] = held
                piece.x[:, own], piece.p[:, i] = self._integration.motion.one_through(
                    i, count, x, held, phi, slope, dt
                )
                x = piece.x[-1, own]

    def advance(self, until: float) -> None:
        """Go on to `until` [s]."""
        self._way.extend(self._integration.to(until))

    def reach(self, until: float) -> None:
        """Let the world follow to `until` [s]: no input that takes effect before is awaited."""
        self.advance(until)
        self._world.follow(self._take_way(until))

    def _take_way(self, until: float) -> Iterator[Piece]:
        while self._way and self._way[0].t < until:
            self._gone += 1
            yield self._way.popleft()

    def in_question(self, who: Sequence[int]) -> list[int]:
        """Whose inputs have to be known before those in `who` can be told what they see.

        Where that is one of them itself, others may be in question once it is known. Of too many
        that are awaited the oldest are in question for all.
        """
        seen = [i for i in self._open if any(self._may_see(j, i) for j in who)]
        return seen or self.open[:-_AT_ONCE]

    def _may_see(self, j: int, i: int) -> bool:
        if j in self._open:
            return i == j  # only then is it known where j is
        dynamics, begun, now = self._bounded[i], self._open[i], self._integration
        if dynamics is None:
            return True
        farthest = travelled(dynamics, begun.x, now.t - begun.t, self._bounds[i])
        return not math.dist(now.p[j], begun.p) > self._radii[j] + farthest + _SLACK


def look_ahead(world: World) -> Synchronization:
    """Lookahead for agents that compute while the plant goes on; sequential where it cannot pay.

    A sample that sees all agents waits for all: it pays where most do not.
    """
    swarm, radii = world.swarm, sensing_radii(world.swarm)
    limited = 2 * np.isfinite(radii).sum() > len(radii)
    adverse = any(group.disturbance.kind == "adverse" for group in swarm.groups)
    if swarm.time.lookahead and limited and not adverse:
        return Lookahead(world, radii)
    return Synchronization(world)
