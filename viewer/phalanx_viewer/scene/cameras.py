"""The visitors' cameras: they hold the whole run, follow the swarm, or follow one agent."""

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx_viewer.scene.view import View, looks_at

_TIGHT, _ROOM, _LOOSE = 1.1, 1.25, 1.8
"""A camera that follows the swarm is put _ROOM times as far away as it must be; and anew when it is
less than _TIGHT or more than _LOOSE times as far."""
_LEASH = 0.04
"""So far may the swarm's middle be from the picture's before it pulls the camera along, in shorter
sides of the picture; _TIGHT leaves that room to those at the edge."""
_SAME = 0.02
"""Distances and aspects that differ by less, relatively, are the same."""
_EXACT = 1e-4
"""What moved by less than this share of its distance from the camera was only rounded."""
_UNDERWAY = 32
"""So many of the views that a browser was asked for are remembered."""
_STEADY = 1.5e-3
"""What moves by less than this share of its distance from the camera seems to stand still."""
_SHAPES_EVERY = 1.0
"""[s]"""
_NUDGE = 2e-5
"""Change of the field of view, relatively: of half as much viser tells no browser."""


class Framing(StrEnum):
    """What cameras keep in sight."""

    RUN = "the whole run"
    SWARM = "the swarm"
    AGENT = "the chosen agent"


@dataclass
class _Visitor:
    """What one visitor's browser was asked to show, and what he made of it."""

    asked: View
    fit: float
    """The distance at which he sees what is to be kept in sight [m]."""
    zoom: float = 1.0
    """By how many times he is farther away."""
    told: deque[View] = field(default_factory=lambda: deque(maxlen=_UNDERWAY))
    """What his browser was asked to show before: a slow one still reports the first of them while
    the last is on its way."""

    def saw(self, seen: View) -> None:
        """Take what his browser reports: what it was not asked for is his own doing."""
        if not any(_expected(seen, told) for told in (self.asked, *self.told)):
            self.zoom *= seen.distance / self.asked.distance
            self.asked = seen
            self.told.clear()

    def ask(self, client: viser.ClientHandle, view: View) -> None:
        """Have his browser show a view."""
        if not _steady(self.asked, view):
            self.told.append(self.asked)
            self.asked = view
            with client.atomic():
                client.camera.position, client.camera.look_at = view.position, view.look_at


class Cameras:
    """Moves every visitor's camera; the direction and the zoom are his."""

    def __init__(self, server: viser.ViserServer, direction: View, reach: float) -> None:
        """Look from a direction; reach is how much around a position is to be seen [m]."""
        self._server, self._first, self._reach = server, direction, reach
        self.framing, self._run = Framing.SWARM, np.zeros((1, 3))
        self._visitors: dict[int, _Visitor] = {}
        self._asked_at, self._nudge = 0.0, _NUDGE
        self.on_keep: Callable[[Framing], None] = lambda _: None
        """Called with what is kept in sight from now on."""

    def expect(self, positions: Array) -> None:
        """Have those who come see all of these positions of a run, shape (s, 3)."""
        self._run = positions
        self._first = first = self._first.fitted(positions, self._reach)
        camera = self._server.initial_camera
        camera.up, camera.fov = tuple(first.up), first.fov
        camera.near, camera.far = 1e-3 * first.distance, 1e2 * first.distance
        camera.position, camera.look_at = tuple(first.position), tuple(first.look_at)

    def keep(self, framing: Framing) -> None:
        """Keep this in sight from now on, from a distance that fits."""
        self.framing = framing
        alone = framing is Framing.AGENT  # from as far away as everybody is now
        known = self._visitors if alone else {}
        self._visitors = {k: _Visitor(v.asked, v.asked.distance) for k, v in known.items()}
        self.on_keep(framing)

    def ask_for_shapes(self) -> None:
        """Have every browser report its picture's shape, once in a while."""
        # By itself a browser does so when its camera moves, but not, or too early, when a panel
        # beside the scene opens or closes. It does whenever its field of view is set.
        now = time.monotonic()
        if now >= self._asked_at + _SHAPES_EVERY:
            self._asked_at, self._nudge = now, -self._nudge
            for client in self._server.get_clients().values():
                client.camera.fov = self._first.fov * (1.0 + self._nudge)

    def show(self, positions: Array, chosen: int | None) -> View:
        """Keep in sight what is to be kept; positions has shape (N, 3).

        Returns:
            Of what visitors see, that in which the swarm is smallest.
        """
        seen = self._seen()
        alone = self.framing is Framing.AGENT and chosen is not None
        kept = positions[chosen : chosen + 1] if alone and chosen is not None else positions
        for key, (client, view) in seen.items():
            if self.framing is Framing.RUN:
                self._fit_run(key, client, view)
            else:
                self._follow(key, client, view, kept, alone)
        views = [view for _, view in seen.values()] or [self._first]
        middle = positions.mean(axis=0, keepdims=True)
        return max(views, key=lambda view: float(view.spans(middle)[0]))

    def _seen(self) -> dict[int, tuple[viser.ClientHandle, View]]:
        """What every visitor sees; one whose browser reports nonsense is left alone."""
        clients = self._server.get_clients()
        self._visitors = {key: who for key, who in self._visitors.items() if key in clients}
        views = {key: (client, self._view(client)) for key, client in clients.items()}
        return {key: (client, view) for key, (client, view) in views.items() if view.possible}

    def _fit_run(self, key: int, client: viser.ClientHandle, seen: View) -> None:
        """Once, and when the picture's shape changed: the visitor may look elsewhere."""
        visitor = self._visitors.get(key)
        if visitor is None or not _close(visitor.asked.aspect, seen.aspect):
            # Whoever just came has no direction of his own, and may not look where he is to yet.
            towards = self._first if visitor is None else seen
            fitted = replace(towards, aspect=seen.aspect).fitted(self._run, self._reach)
            self._visitors[key] = visitor = _Visitor(seen, fitted.distance)
            visitor.ask(client, fitted)

    def _follow(
        self, key: int, client: viser.ClientHandle, seen: View, positions: Array, alone: bool
    ) -> None:
        visitor = self._visitors.get(key)
        if visitor is None:
            # Whoever just came may not look where he is to yet.
            first = replace(self._first, aspect=seen.aspect, pixels=seen.pixels)
            visitor = self._visitors[key] = _Visitor(seen, first.distance)
            seen = first
        else:
            if not _close(seen.distance, self._first.distance):  # his browser put him there
                visitor.saw(seen)
            if not _close(seen.distance, visitor.asked.distance):  # it has not obeyed yet
                seen = replace(visitor.asked, aspect=seen.aspect, pixels=seen.pixels)
        fitted = seen.fitted(positions, self._reach)
        look_at = fitted.look_at
        if not alone:
            if _TIGHT <= visitor.fit / fitted.distance <= _LOOSE:
                look_at = seen.pulled(look_at, _LEASH)
            else:
                visitor.fit = _ROOM * fitted.distance
        visitor.ask(client, seen.moved(look_at, visitor.fit * visitor.zoom))

    def _view(self, client: viser.ClientHandle) -> View:
        camera = client.camera
        wide, high = max(camera.image_width, 1), max(camera.image_height, 1)  # hidden: 0 by 0
        # Nobody can change the field of view but ask_for_shapes(), by less than is seen; all that
        # is sized by it would be sent anew each time.
        fov = self._first.fov
        position, look_at, up = camera.position, camera.look_at, camera.up_direction
        seen = View(position, look_at, up, fov, wide / high, min(wide, high))
        visitor = self._visitors.get(client.client_id)
        if visitor is None or looks_at(look_at, position, camera.wxyz):
            return seen
        # A browser that is asked for its shape before it has drawn what it was asked to show tells
        # where it looks next, but still where it is: as a direction that would be a tilted one.
        return replace(visitor.asked, aspect=seen.aspect, pixels=seen.pixels)


def _close(a: float, b: float) -> bool:
    return abs(a - b) <= _SAME * b


def _expected(seen: View, told: View) -> bool:
    """Whether somebody may see this who was told to look so.

    A report that comes while viser is told of a new view, position first, leaves it with the
    position of one and the middle of the other. Who zooms moves: his position is new too.
    """
    there = np.abs(seen.position - told.position).max() <= _EXACT * told.distance
    return bool(there) or _close(seen.distance, told.distance)


def _steady(a: View, b: View) -> bool:
    moved = max(np.abs(a.position - b.position).max(), np.abs(a.look_at - b.look_at).max())
    return bool(moved <= _STEADY * b.distance)
