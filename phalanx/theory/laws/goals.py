"""Goals: where an agent should be at each time, and what gives them.

A reference gives an agent's goal at a time: a point, waypoints, a path, or another agent's place.
Formations and flows give goals to all agents together.
"""

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Annotated, NamedTuple, Protocol, runtime_checkable

import numpy as np
from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from msgspec import Struct

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import length


class Goal(NamedTuple):
    """A desired position with its first two time derivatives, shapes (2,) or (3,).

    >>> Goal(np.array([1.0, 2.0]), np.zeros(2), np.zeros(2)).position
    array([1., 2.])
    """

    position: Array
    """p^d [m]"""
    velocity: Array
    """v^d [m/s]"""
    acceleration: Array
    """a^d [m/s²]"""


def hold(position: Array) -> Goal:
    """The goal of an agent that stays at a position."""
    return Goal(position, np.zeros_like(position), np.zeros_like(position))


class Motion(NamedTuple):
    """An agent's output point as its state has it, shapes (2,) or (3,).

    >>> Motion(position=np.ones(2), velocity=np.zeros(2)).position
    array([1., 1.])
    """

    position: Array
    """p [m]"""
    velocity: Array
    """The part of p' that does not depend on the input [m/s]: all of it for q > 1, 0 for q = 1."""


class Sight(Struct, frozen=True):
    """A reference's arguments at one sampling instant.

    >>> sight = Sight(0.5, "a", lambda name: Motion(np.ones(2), np.zeros(2)))
    >>> sight.position
    array([1., 1.])
    """

    t: float
    """[s]"""
    agent: str
    """The agent's own name."""
    motion: Callable[[str], Motion | None]
    """The motion of an agent by name; None if it is out of sight."""

    @property
    def position(self) -> Array:
        """The agent's own position [m]."""
        motion = self.motion(self.agent)
        assert motion is not None, "an agent sees itself"
        return motion.position


@runtime_checkable
class Reference(Protocol):
    """A source of an agent's goal; a scenario names it ``package.module:Name``.

    >>> class Rising:
    ...     def goal(self, sight):
    ...         return Goal(np.array([0.0, sight.t]), np.array([0.0, 1.0]), np.zeros(2))
    ...     def end(self):
    ...         return None
    >>> isinstance(Rising(), Reference)
    True
    """

    def goal(self, sight: Sight) -> Goal:
        """The goal now. Each agent has a reference of its own, which may keep state."""

    def end(self) -> Array | None:
        """The position [m] where the goal comes to rest, shape (d,); None if it never does."""


Coordinate = Annotated[float, Ge(-1e9), Le(1e9)]
"""[m]; the bounds keep out numbers that are not finite."""
Point = Annotated[tuple[Coordinate, ...], MinLen(2), MaxLen(3)]
Points = Annotated[tuple[Point, ...], MinLen(1)]


@dataclass(frozen=True)
class FixedPoint:
    """One position for the whole run.

    >>> FixedPoint(position=(1.0, 2.0)).end()
    array([1., 2.])
    """

    position: Point

    @property
    def axes(self) -> int:
        return len(self.position)

    def end(self) -> Array | None:
        return self._goal.position

    def goal(self, sight: Sight) -> Goal:
        return self._goal

    @cached_property
    def _goal(self) -> Goal:
        return hold(np.array(self.position))


class Polyline:
    """A point that is at given places at given times, moves straight between them, and then rests.

    Before the first of these times it rests at the first place.
    """

    def __init__(self, points: Array, times: Sequence[float]) -> None:
        """points: shape (k, d) [m]. times: k of them, increasing [s]."""
        self.points, self.times = points, list(times)
        self.velocities = np.diff(points, axis=0) / np.diff(self.times)[:, None]

    def at(self, t: float) -> Goal:
        """The point's position and derivatives at t [s]; its acceleration is 0."""
        passed = bisect_right(self.times, t)
        if passed in (0, len(self.times)):
            return hold(self.points[max(passed - 1, 0)])
        velocity = self.velocities[passed - 1]
        since = t - self.times[passed - 1]
        return Goal(self.points[passed - 1] + since * velocity, velocity, np.zeros_like(velocity))


@dataclass
class Waypoints:
    """Positions to pass in order: at given times, or each once the one before it is reached.

    >>> points = Waypoints(points=((0.0, 0.0), (2.0, 0.0)), times=(0.0, 4.0))
    >>> points.goal(Sight(1.0, "a", None)).position
    array([0.5, 0. ])
    """

    points: Points
    times: tuple[Annotated[float, Ge(0), Le(1e9)], ...] = ()
    """When to be at each point [s]; between them the goal moves straight, with constant speed."""
    tolerance: Annotated[float, Gt(0)] | None = None
    """How near a point counts as reached [m]; the goal is then the next point, and rests there."""

    def __post_init__(self) -> None:
        _require_one_space(self.points)
        if bool(self.times) == (self.tolerance is not None):
            raise ValueError("expected either times or a tolerance")
        if self.times and len(self.times) != len(self.points):
            raise ValueError(f"expected a time for each of the {len(self.points)} points")
        if any(later <= earlier for earlier, later in pairwise(self.times)):
            raise ValueError("expected times that increase")
        self._points = np.array(self.points)
        self.timed = Polyline(self._points, self.times) if self.times else None
        self.reached = 0
        """How many points were reached, and so the index of the next one."""

    @property
    def axes(self) -> int:
        return len(self.points[0])

    def end(self) -> Array | None:
        last: Array = self._points[-1]
        return last

    def goal(self, sight: Sight) -> Goal:
        if self.timed:
            return self.timed.at(sight.t)
        assert self.tolerance is not None
        here = sight.position
        while self.reached < len(self._points) - 1:
            if float(length(self._points[self.reached] - here)) > self.tolerance:
                break
            self.reached += 1
        return hold(self._points[self.reached])


@dataclass(frozen=True)
class PathAtSpeed:
    """A polyline along which the goal moves from its first point on, and rests at its last.

    >>> path = PathAtSpeed(points=((0.0, 0.0), (2.0, 0.0)), speed=0.5)
    >>> path.goal(Sight(1.0, "a", None)).velocity
    array([0.5, 0. ])
    """

    points: Annotated[Points, MinLen(2)]
    speed: Annotated[float, Gt(0), Le(1e9)]
    """[m/s]"""

    def __post_init__(self) -> None:
        _require_one_space(self.points)
        if any(here == there for here, there in pairwise(self.points)):
            raise ValueError("expected points that differ from the one before")

    @property
    def axes(self) -> int:
        return len(self.points[0])

    def end(self) -> Array | None:
        return np.array(self.points[-1])

    def goal(self, sight: Sight) -> Goal:
        return self.polyline.at(sight.t)

    @cached_property
    def polyline(self) -> Polyline:
        points, times = np.array(self.points), [0.0]
        for step in length(np.diff(points, axis=0)).tolist():
            times.append(times[-1] + step / self.speed)
        return Polyline(points, times)


@dataclass(frozen=True)
class Stay:
    """The agent's own position: it stays where it is."""

    def end(self) -> Array | None:
        return None

    def goal(self, sight: Sight) -> Goal:
        return hold(sight.position)


def _require_one_space(points: Sequence[Sequence[float]]) -> None:
    if len({len(point) for point in points}) != 1:
        raise ValueError("expected points that are all 2-D or all 3-D")
