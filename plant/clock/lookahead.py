"""States ahead of the answers: what is known of the swarm while some inputs are still awaited.

Nobody's motion depends on another's, so that the states of those who have answered are known
however long others take. An agent that has not is somewhere within what its dynamics let it travel:
as long as that is out of another agent's sight, it makes no difference to that agent's sample.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.plant.world.disturbance import SwarmDisturbance
from phalanx.plant.world.motion import Motion
from phalanx.plant.world.steps import Stretch, next_stretch
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.models.dynamics import Bounded
from phalanx.theory.safety.composition import stacked_slices

Array = NDArray[np.float64]

_SLACK = 1e-6
"""More than integration and rounding can be off [m]."""


class _Course(NamedTuple):
    """One stretch that all agents went."""

    stretch: Stretch
    phi: Array
    slope: Array


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
    course: int
    """Number of the first stretch that it went since."""


class Lookahead:
    """The stacked state at an instant that the world has not reached: NaN where it is not known."""

    def __init__(self, rows: SafetyRows, motion: Motion, radii: Array) -> None:
        """Begin at x(0), with every actuator at zero.

        Args:
            rows: of the scenario. No disturbance may depend on the state.
            motion: of the world, which goes the same steps later.
            radii: how far each agent sees [m].
        """
        swarm = rows.swarm
        self.t = 0.0
        """[s]"""
        self.x = swarm.start()
        """shape (n̄,)"""
        self.p = motion.positions(self.x)
        """Output positions at x [m], shape (N, d)."""
        self._motion, self._radii = motion, radii
        self._parts = swarm.safe_set.parts
        dynamics = [m.dynamics for m in swarm.members]
        self._bounded = [each if isinstance(each, Bounded) else None for each in dynamics]
        self._inputs = stacked_slices([len(m.dynamics.inputs) for m in swarm.members])
        self._u = np.zeros(self._inputs[-1].stop)
        self._longest = swarm.scenario.time.integration_step
        self._bounds = [group.disturbance.bound for group in swarm.groups]
        self._disturbances = SwarmDisturbance(rows)
        self._line = self._disturbances.line(0.0, self.x)
        self._open: dict[int, _Open] = {}
        self._courses: deque[_Course] = deque()
        """All since the oldest awaited input took effect."""
        self._first = 0
        """Number of the first of them."""

    @property
    def open(self) -> list[int]:
        """Whose inputs are awaited, the longest awaited first."""
        return list(self._open)

    def begin_awaiting(self, i: int) -> None:
        """From now on agent i holds an input that is not known yet."""
        course = self._first + len(self._courses)
        u = self._u[self._inputs[i]].copy()
        x, p = self.x[self._parts[i]].copy(), self.p[i].copy()
        self._open[i] = _Open(self.t, x, p, u, course)
        self._u[self._inputs[i]] = np.nan

    def end_awaiting(self, i: int, u: Array | None) -> None:
        """Agent i's awaited input is u, shape (m_i,): its state is known again.

        None: it was lost, and the actuator holds what it did.
        """
        begun = self._open.pop(i)
        x, p, own = begun.x, begun.p, self._parts[i]
        held = begun.u if u is None else u
        for place in range(begun.course - self._first, len(self._courses)):
            (count, dt, _), phi, slope = self._courses[place]
            went = self._motion.one_through(i, count, x, held, phi[own], slope[own], dt)
            x, p = went[0][-1], went[1][-1]
        self._u[self._inputs[i]] = held
        self.x[own], self.p[i] = x, p
        oldest = min((o.course for o in self._open.values()), default=math.inf)
        while self._courses and self._first < oldest:
            self._courses.popleft()
            self._first += 1

    def advance(self, until: float) -> None:
        """Go on to `until` [s]."""
        while self.t < until:
            if self._line.end <= self.t:
                self._line = self._disturbances.line(self.t, self.x)
            stretch = next_stretch(self.t, until, self._line.end, self._longest)
            course = _Course(stretch, self._line.at(self.t), self._line.slope)
            self._courses.append(course)
            count, dt, self.t = stretch
            x, p = self._motion.steps(count, self.x, self._u, course.phi, course.slope, dt)
            self.x, self.p = x[-1], p[-1]
        if not self._open:
            self._first += len(self._courses)
            self._courses.clear()

    def in_question(self, who: Sequence[int]) -> list[int]:
        """Whose inputs have to be known before those in `who` can be told what they see.

        Where that is one of them itself, others may be in question once it is known.
        """
        if not self._open:
            return []
        return [i for i in self._open if any(self._may_see(j, self.p[j], i) for j in who)]

    def _may_see(self, j: int, p: Array, i: int) -> bool:
        if j in self._open:
            return i == j  # only then is it known where j is
        dynamics, begun = self._bounded[i], self._open[i]
        if dynamics is None:
            return True
        travelled = dynamics.travel(begun.x, self.t - begun.t, self._bounds[i])
        return not math.dist(p, begun.p) > self._radii[j] + travelled + _SLACK
