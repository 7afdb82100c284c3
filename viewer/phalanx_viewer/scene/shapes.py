"""The scene as plain shapes, which the writers for Foxglove, rerun and ROS 2 convert."""

from collections.abc import Iterator
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx_viewer.scene.colours import OBSTACLE, Colour
from phalanx_viewer.scene.model import SceneModel

Size = tuple[float, float, float]

_FAINT = 0.25
_THIN = 0.02
"""Height of a disc in the plane [m]."""
_WALL = (0.1, 40.0)
"""Thickness and length of a wall [m]."""
_ORIGIN, _NO_TURN = np.zeros(3), np.zeros(3)
_AHEAD, _UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
_NO_POINTS = np.zeros((0, 3))


class Kind(Enum):
    """A kind of shape; the text says what its size means."""

    ARROW = auto()
    """Tail at its place, along x: length, and the head's width and height."""
    TEXT = auto()
    """Only the last: its height."""
    BALL = auto()
    """Diameters."""
    DISC = auto()
    """Diameters and height."""
    BOX = auto()
    """Sides."""
    LINE = auto()
    """A strip through `points`; without a size."""


class Shape(NamedTuple):
    """One shape of the scene."""

    group: str
    """The kind of thing it shows, such as "wall"."""
    number: int
    """Within the group."""
    kind: Kind
    colour: Colour
    place: Array = _ORIGIN
    """[m], shape (3,)"""
    heading: Array = _NO_TURN
    """Unit vector along its x-axis, shape (3,); zero: not rotated."""
    size: Size = (0.0, 0.0, 0.0)
    """[m]"""
    opacity: float = 1.0
    text: str = ""
    points: Array = _NO_POINTS
    """Points of a line [m], shape (s, 3)."""


def agent_shapes(
    model: SceneModel, i: int, colour: Colour, place: Array = _ORIGIN, heading: Array = _AHEAD
) -> Iterator[Shape]:
    """An agent's arrow, name and safety radius, at a place; by default in its own frame."""
    body, reach = model.body, 2.0 * model.radius
    size = 2.0 * body, body, body
    yield Shape("agent", i, Kind.ARROW, colour, place - body * heading, heading, size)
    above = place + 1.5 * body * _UP
    yield Shape("name", i, Kind.TEXT, colour, above, size=(0.0, 0.0, body), text=model.names[i])
    if reach:
        kind, height = (Kind.DISC, _THIN) if model.flat else (Kind.BALL, reach)
        size = reach, reach, height
        yield Shape("safety radius", i, kind, colour, place, size=size, opacity=_FAINT)


def static_shapes(model: SceneModel) -> Iterator[Shape]:
    """Obstacles, walls, limits and the formation's path."""
    static = model.static
    for k, (center, radius) in enumerate(static.spheres):
        yield Shape("obstacle", k, Kind.BALL, OBSTACLE, center, size=(2.0 * radius,) * 3)
    thick, long = _WALL
    for k, (surface, normal) in enumerate(static.walls):
        place, size = surface + 0.5 * thick * normal, (thick, long, long)
        yield Shape("wall", k, Kind.BOX, OBSTACLE, place, normal, size, 2.0 * _FAINT)
    for k, line in enumerate(static.outlines):
        yield Shape("limit", k, Kind.LINE, OBSTACLE, points=line)
    if len(static.path):
        yield Shape("path", 0, Kind.LINE, OBSTACLE, points=static.path)
