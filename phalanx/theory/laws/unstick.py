"""A law around another: robots that wait for one another make a detour, by priority.

Rows and proofs stay as they are: only the wish changes.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
from msgspec.structs import replace as with_goal

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length
from phalanx.theory.laws.goals import hold
from phalanx.theory.laws.law import Law, TeamLaw, View
from phalanx.theory.models.dynamics import Dynamics, Positive
from phalanx.theory.safety.composition import Member
from phalanx.theory.safety.obstacles import Obstacle


@dataclass
class Unstick:
    """The law `of`, but with another goal for a while when the agent stands away from its own.

    Among those that are near, the normal agent of the lowest index goes straight on; each other
    one backs off from the nearest and to the right of its way, for longer the more precede it.

    >>> law = Unstick(of=TrackVelocity(gain=1.0))
    >>> law.prepare(SingleIntegrator(speed=1.0))
    """

    of: Law
    """The law of the wish."""
    patience: Positive = 1.0
    """How long it stands before it makes a detour [s]."""
    still: Positive = 0.1
    """It stands while it moves less than this [m]."""
    arrival: Positive = 0.5
    """At this distance from its goal it may stand [m]."""
    within: Positive = 5.0
    """Distance up to which others count [m]."""
    aside: Positive = 2.0
    """Length of a detour [m], and its least duration [s]."""

    @property
    def without_goal(self) -> bool:
        """True if the law uses no goal."""
        return bool(getattr(self.of, "without_goal", False))

    def prepare(self, dynamics: Dynamics) -> None:
        self.of.prepare(dynamics)

    def join(self, i: int, members: Sequence[Member], obstacles: Sequence[Obstacle]) -> Law:
        of = self.of.join(i, members, obstacles) if isinstance(self.of, TeamLaw) else self.of
        return _Detours(replace(self, of=of))

    def input(self, view: View) -> Array:
        return self.of.input(view)


class _Detours:
    """One agent's detours."""

    def __init__(self, options: Unstick) -> None:
        self._options, self._past = options, deque[tuple[float, Array]]()
        self._goal: Array | None = None
        self._until = 0.0
        """The end of the detour to this goal [s]."""

    def prepare(self, dynamics: Dynamics) -> None:
        self._options.prepare(dynamics)

    def input(self, view: View) -> Array:
        if view.t >= self._until:
            self._goal = self._detour(view) if self._stands(view) else None
        if self._goal is not None:
            view = with_goal(view, goal=hold(self._goal))
        return self._options.of.input(view)

    def _stands(self, view: View) -> bool:
        """True if the agent has stood away from its goal for as long as its patience."""
        p, since = view.positions[view.i], view.t - self._options.patience
        self._past.append((view.t, p))
        old = len(list(takewhile(lambda entry: entry[0] <= since, self._past)))
        for _ in range(old - 1):  # the oldest that is left is at least so old
            self._past.popleft()
        moved = max(float(length(q - p)) for _, q in self._past)
        away = float(length(view.goal.position - p))
        return old > 0 and moved <= self._options.still and away > self._options.arrival

    def _detour(self, view: View) -> Array | None:
        """A place behind and to the right; None for the first by priority, or one alone."""
        options, p = self._options, view.positions[view.i]
        near = {
            l: float(length(q - p))
            for l, q in view.positions.items()
            if l != view.i and 0.0 < float(length(q - p)) <= options.within
        }
        before = [l for l in near if l in view.normal and l < view.i]
        self._past.clear()
        self._until = view.t + options.aside * (1 + len(before))
        if not near or not before:
            return None
        from_nearest = p - view.positions[min(near, key=lambda l: (near[l], l))]
        way = view.goal.position - p
        right = np.concatenate(([way[1], -way[0]], np.zeros(len(way) - 2)))
        aside = from_nearest / length(from_nearest) + right / max(float(length(right)), 1e-9)
        place: Array = p + options.aside * aside
        return place
