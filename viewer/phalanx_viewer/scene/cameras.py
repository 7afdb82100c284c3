"""Camera views, and a visitor's camera: it shows a whole run, follows the swarm or one agent."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Self

import numpy as np
import viser

from phalanx.theory.arrays import Array
from phalanx_viewer.scene.model import unit

_TIGHT, _ROOM, _LOOSE = 1.1, 1.25, 1.8
"""A camera that follows the swarm is put _ROOM times as far away as needed to see all of it, and
again when it is less than _TIGHT or more than _LOOSE times as far."""
_LEASH = 0.04
"""Distance of the swarm's middle from the picture's at which the camera begins to follow, in
shorter sides of the picture; _TIGHT leaves that room to agents at the edge."""
_EDGE, _MOST_EDGE = 0.075, 0.3
"""Room for names and enlarged bodies at the edges, in shorter sides of a usual picture, and at most
in those of a small one."""
_SAME = 0.02
"""Distances and aspects that differ by less, relatively, are the same."""
_REMEMBERED = 256
"""Number of requested views that are remembered for each browser."""
_EXACT, _STEADY = 1e-4, 1.5e-3
"""Moves below these shares of the distance from the camera are rounding alone, and invisible."""
_SHAPES_EVERY = 1.0
"""[s]"""
_NUDGE = 2e-5
"""Relative change of the field of view: viser does not send half as much to a browser."""
_FAR = 1e9
"""Farther than any scene reaches [m]."""
_USUAL = 620.0
"""Shorter side of a usual picture [pixels]."""
_SAME_DIRECTION = 1e-4
"""Directions that differ by less are the same [rad]."""


@dataclass(frozen=True)
class View:
    """A perspective camera."""

    position: Array
    """[m], shape (3,)."""
    look_at: Array
    """Point in the middle of the picture [m], shape (3,)."""
    up: Array
    """Shape (3,), not along the line of sight."""
    fov: float
    """Vertical field of view [rad]."""
    aspect: float
    """Width of the picture over its height."""
    pixels: float = _USUAL
    """Length of the picture's shorter side."""

    @property
    def possible(self) -> bool:
        """True if all numbers are finite, and the direction is defined."""
        numbers = np.array([*self.position, *self.look_at, *self.up, self.fov, self.aspect])
        finite = bool((np.abs(numbers) < _FAR).all())
        return finite and 0.0 < self.fov < np.pi and bool(self.axes.any(axis=1).all())

    @cached_property
    def axes(self) -> Array:
        """Unit vectors to the right, up and forward in the picture, shape (3, 3)."""
        forward = unit(self.look_at - self.position)
        right = unit(np.cross(forward, self.up))
        return np.stack([right, np.cross(right, forward), forward])

    @property
    def distance(self) -> float:
        """Distance from the camera to the point that it looks at [m]."""
        return float(np.linalg.norm(self.look_at - self.position))

    @property
    def enlargement(self) -> float:
        """Factor by which a thing of the same pixels takes more of a picture smaller than usual."""
        # Never less than 1: on a screen with finer pixels there are more of them.
        return max(1.0, _USUAL / self.pixels)

    def spans(self, points: Array) -> Array:
        """Length that fills the shorter side of the picture at each point [m], shape (N,)."""
        depths = np.maximum((points - self.position) @ self.axes[2], 1e-6)
        lengths: Array = 2.0 * np.tan(self.fov / 2.0) * min(1.0, self.aspect) * depths
        return lengths

    def project(self, points: Array) -> Array:
        """Project points, shape (N, 3): right and up of the middle, in shorter sides, (N, 2)."""
        projected: Array = (points - self.position) @ self.axes[:2].T
        return projected / self.spans(points)[:, None]

    def holds(self, points: Array) -> bool:
        """True if all points, shape (N, 3), are in the picture."""
        across, high = np.abs(self.project(points)).T * min(1.0, self.aspect)
        in_front = (points - self.position) @ self.axes[2] > 0.0
        return bool((in_front & (across <= 0.5 * self.aspect) & (high <= 0.5)).all())

    def fitted(self, points: Array, reach: float, edge: float = _EDGE) -> Self:
        """Return the nearest camera of the same direction that sees balls around points.

        points: their centres [m], shape (N, 3). reach: their radius [m]. edge: part of a usual
        picture to leave free at each side, in shorter sides.
        """
        free = 2.0 * min(edge * self.enlargement, _MOST_EDGE) * min(1.0, self.aspect)
        tan = np.tan(self.fov / 2.0) * (np.array([self.aspect, 1.0]) - free)
        across, along = points @ self.axes[:2].T, points @ self.axes[2]
        # A ball is left of the picture's right edge if its centre's distance from that plane is at
        # least `reach`; likewise for the other edges. The camera backs off until all are.
        beyond = reach * np.sqrt(1.0 + tan**2) - along[:, None] * tan
        most, least = (beyond + across).max(axis=0), (beyond - across).max(axis=0)
        depth = float((-(most + least) / (2.0 * tan)).min())
        sideways = (most - least) / 2.0
        position = np.array([*sideways, depth]) @ self.axes
        middle = (along.min() + along.max()) / 2.0
        return replace(self, position=position, look_at=position + self.axes[2] * (middle - depth))

    def pulled(self, towards: Array, leash: float) -> Array:
        """The point to look at [m] to keep `towards` within `leash` shorter sides of it."""
        pull = towards - self.look_at
        slack = leash * float(self.spans(self.look_at[None])[0])
        length = max(float(np.linalg.norm(pull)), 1e-9)
        point: Array = self.look_at + max(0.0, 1.0 - slack / length) * pull
        return point

    def moved(self, look_at: Array, distance: float) -> Self:
        """Return a view of another point from another distance [m], in the same direction."""
        return replace(self, look_at=look_at, position=look_at - distance * self.axes[2])


def looks_at(point: Array, position: Array, wxyz: Array) -> bool:
    """True if a camera of this orientation, a unit quaternion, has a point straight ahead."""
    w, x, y, z = wxyz
    forward = np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
    return bool(np.linalg.norm(unit(point - position) - forward) < _SAME_DIRECTION)


class Framing(StrEnum):
    """The part of a run that a camera shows."""

    RUN = "the whole run"
    SWARM = "the swarm"
    AGENT = "the chosen agent"


@dataclass
class _Moved:
    """The views that a visitor's browser was sent, and the visitor's own zoom."""

    last: View
    """The last view."""
    fit: float
    """Distance at which the visitor sees everything to be shown [m]."""
    zoom: float = 1.0
    """The visitor's own factor on that distance."""
    earlier: deque[View] = field(default_factory=lambda: deque(maxlen=_REMEMBERED))
    """Earlier views: a slow browser may still report the first one after the last was sent."""

    def on_report(self, view: View) -> None:
        """Handle a view that the browser reports: one that it was not sent is the visitor's."""
        if not any(_expected(view, target) for target in (self.last, *self.earlier)):
            self.zoom *= view.distance / self.last.distance
            self.last = view
            self.earlier.clear()

    def send(self, client: viser.ClientHandle, view: View) -> None:
        """Make the browser show a view."""
        if not _steady(self.last, view):
            self.earlier.append(self.last)
            self.last = view
            with client.atomic():
                client.camera.position, client.camera.look_at = view.position, view.look_at


class Camera:
    """Moves one visitor's camera; direction and zoom are the visitor's own."""

    def __init__(
        self, client: viser.ClientHandle | None, first: View, reach: float, positions: Array
    ) -> None:
        """Look in the direction of a view; without a client nothing moves.

        reach: radius around a position that is shown [m]. positions: as expect() takes them.
        """
        self._client, self._first, self._reach = client, first, reach
        self.framing = Framing.SWARM
        self._moved: _Moved | None = None
        self._requested_at, self._nudge = 0.0, _NUDGE
        self.on_keep: Callable[[Framing], None] = lambda _: None
        """Called with each change of `framing`."""
        self.expect(positions)

    def expect(self, positions: Array) -> None:
        """Begin with a view of all of these positions of a run, shape (s, 3)."""
        self._run, self._first = positions, self._first.fitted(positions, self._reach)
        self._bounds = positions.min(axis=0), positions.max(axis=0)

    def keep(self, framing: Framing) -> None:
        """Set the part of the run that is shown; one agent from the visitor's distance."""
        moved, self.framing = self._moved, framing
        follows = moved is not None and framing is Framing.AGENT
        self._moved = _Moved(moved.last, moved.last.distance) if moved and follows else None
        self.on_keep(framing)

    def request_shape(self) -> None:
        """Make the browser report its picture's shape, every _SHAPES_EVERY seconds."""
        # By itself a browser does so when its camera moves, but not, or too early, when a panel
        # next to the scene opens or closes. It does whenever its field of view is set.
        now = time.monotonic()
        if self._client is not None and now >= self._requested_at + _SHAPES_EVERY:
            self._requested_at, self._nudge = now, -self._nudge
            self._client.camera.fov = self._first.fov * (1.0 + self._nudge)

    def show(self, positions: Array, chosen: int | None) -> View:
        """Move the camera to what it shows of positions, shape (N, 3); return what is seen."""
        if self._client is None or not (view := self._view(self._client)).possible:
            return self._first  # a browser may report an impossible one
        if self._moved and _steady(view, self._first) and not _steady(self._moved.last, view):
            self._moved = None  # back where it began, such as by viser's button
        if self.framing is Framing.RUN:
            self._fit_run(self._client, view, positions)
        else:
            only = chosen if self.framing is Framing.AGENT else None
            self._follow(self._client, view, positions, only)
        return view

    def _fit_run(self, client: viser.ClientHandle, view: View, positions: Array) -> None:
        """Show the whole run once, and when the picture's shape or the known run changed."""
        moved, (low, high) = self._moved, self._bounds
        beyond = np.maximum(positions - high, low - positions).max() > self._reach
        if beyond:  # a live run goes on: show more than it has reached, so that this is seldom
            middle = (low + high) / 2.0
            self._run = np.concatenate([self._run, middle + _LOOSE * (positions - middle)])
            self._bounds = self._run.min(axis=0), self._run.max(axis=0)
        if moved is None or beyond or not _close(moved.last.aspect, view.aspect):
            # A new visitor has no direction of its own, and its camera may not be in place yet.
            towards = self._first if moved is None else view
            towards = replace(towards, aspect=view.aspect, pixels=view.pixels)
            fitted = towards.fitted(self._run, self._reach)
            self._moved = _Moved(view, fitted.distance)
            self._moved.send(client, fitted)

    def _follow(
        self, client: viser.ClientHandle, view: View, positions: Array, only: int | None
    ) -> None:
        moved = self._moved
        if moved is None:  # the camera may not be in place yet
            first = replace(self._first, aspect=view.aspect, pixels=view.pixels)
            moved = self._moved = _Moved(view, first.distance)
            view = first
        else:
            if not _close(view.distance, self._first.distance):  # where every browser begins
                moved.on_report(view)
            if not _close(view.distance, moved.last.distance):  # the view sent is on its way
                view = replace(moved.last, aspect=view.aspect, pixels=view.pixels)
        fitted = view.fitted(positions if only is None else positions[[only]], self._reach)
        look_at = fitted.look_at
        if only is None:
            if _TIGHT <= moved.fit / fitted.distance <= _LOOSE:
                look_at = view.pulled(look_at, _LEASH)
            else:
                moved.fit = _ROOM * fitted.distance
        moved.send(client, view.moved(look_at, moved.fit * moved.zoom))

    def _view(self, client: viser.ClientHandle) -> View:
        camera, fov = client.camera, self._first.fov
        wide, high = max(camera.image_width, 1), max(camera.image_height, 1)  # hidden: 0 by 0
        # Only request_shape() changes the field of view, invisibly; everything that is sized by it
        # would be sent again each time.
        position, look_at, up = camera.position, camera.look_at, camera.up_direction
        view = View(position, look_at, up, fov, wide / high, min(wide, high))
        if self._moved is None or looks_at(look_at, position, camera.wxyz):
            return view
        # A browser that reports before it has drawn the view that it was sent gives the new point
        # that it looks at, but its old position: together a tilted direction.
        return replace(self._moved.last, aspect=view.aspect, pixels=view.pixels)


def _close(a: float, b: float) -> bool:
    return abs(a - b) <= _SAME * b


def _expected(reported: View, target: View) -> bool:
    """True if a browser that was sent one view may report the other.

    viser takes over a new view position first: a report meanwhile leaves it with the position of
    one view and the middle of the other. A visitor who zooms changes the position too.
    """
    there = np.abs(reported.position - target.position).max() <= _EXACT * target.distance
    return bool(there) or _close(reported.distance, target.distance)


def _steady(a: View, b: View) -> bool:
    moved = max(np.abs(a.position - b.position).max(), np.abs(a.look_at - b.look_at).max())
    return bool(moved <= _STEADY * b.distance)
