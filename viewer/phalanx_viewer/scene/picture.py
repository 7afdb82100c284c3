"""The scene as data: the picture of one frame, and plain shapes for Foxglove and ROS 2."""

from collections.abc import Iterator
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from phalanx.guarantee.verdict import Violation
from phalanx.messages.frames import Frame
from phalanx.theory.arrays import Array, Mask
from phalanx_viewer.scene.colours import COLOURS, OBSTACLE, Colour, role
from phalanx_viewer.scene.model import SceneModel, unit

Size = tuple[float, float, float]

_FAINT = 0.25
_THIN = 0.02
"""Height of a disc in the plane [m]."""
_WALL = (0.1, 40.0)
"""Thickness and length of a wall [m]."""
_ORIGIN, _NO_TURN = np.zeros(3), np.zeros(3)
_AHEAD, _UP = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
_NO_POINTS = np.zeros((0, 3))


class Picture:
    """One frame, ready to draw; everything in 3-D and in metres."""

    def __init__(self, model: SceneModel, frame: Frame) -> None:
        x, agents = np.frombuffer(frame.x, dtype="<f8"), frame.agents
        poses = model.kinematics.poses(x)
        self.positions = p = poses.positions
        """Output points, shape (N, 3)."""
        self.goals = model.goals(frame.t, x)
        """Their goals, shape (N, 3); NaN where none is known."""
        steps = [status.step for status in agents]
        self.applied = _arrows(model, x, [step.u if step else () for step in steps])
        """Applied inputs as arrows, shape (N, 3)."""
        self.u_nom = _arrows(model, x, [step.u_nom if step else () for step in steps])
        """Nominal inputs as arrows, shape (N, 3)."""
        has_heading = poses.headings.any(axis=1, keepdims=True)
        self.headings = np.where(has_heading, poses.headings, unit(self.applied))
        """Unit vectors, shape (N, 3): an agent's heading, else its input's direction, else zero."""
        self.roles = [role(s, bool(a)) for s, a in zip(agents, model.adversary, strict=True)]
        self.colours = np.array([COLOURS[role] for role in self.roles], dtype=np.uint8)
        """The agents' colours, shape (N, 3)."""
        self.liars = np.array([status.lies > 0 for status in agents])
        """True for agents that sent false broadcasts, shape (N,)."""
        self.pair = frame.pair
        """The pair with a normal agent whose h is largest."""
        self.worst_pair = model.ends(frame.pair, p)
        """Its ends, shapes (3,)."""
        self.worst_pair_text = f"{model.label(frame.pair)}: {model.pair_text(frame.pair, x, p)}"
        # h_tot is never below the largest h.
        unsafe, values = frame.h_tot > 0.0, model.values
        self.unsafe = values.unsafe(x, frame.turned).tolist() if unsafe else []
        """The pairs with a normal agent and h > 0, the largest h first."""
        self.unsafe_ends = np.array([model.ends(k, p) for k in self.unsafe]).reshape(-1, 2, 3)
        """Positions of their sides, shape (v, 2, 3)."""
        self.unsafe_agents = np.isin(np.arange(len(p)), list(model.agents_of(self.unsafe)))
        """True for agents in one of them, shape (N,)."""
        self.unsafe_lines = unsafe_lines(model, self.unsafe, frame.violations, x, p)
        self.past_lines = past_lines(model, self.unsafe, frame.violations, frame.t)
        """Of pairs that were unsafe, or have no normal agent."""
        excluded = values.unsafe(x).tolist() if unsafe and frame.turned else []
        self.past_lines += [
            f"{model.label(pair)}: {model.pair_text(pair, x, p)}, not counted: no normal agent is "
            "left in it"
            for pair in excluded
            if pair not in self.unsafe
        ]
        sides = [(event.sender, event.receiver) for event in frame.link_events]
        self.link_agents = np.array(sides, dtype=np.intp).reshape(-1, 2)
        """Senders and receivers of links that lost or delayed a broadcast, shape (l, 2)."""
        self.links = p[self.link_agents]
        """Their positions, shape (l, 2, 3)."""
        self.lost = np.array([event.delay < 0.0 for event in frame.link_events], dtype=bool)
        """True for links that lost it, shape (l,)."""

    def links_of(self, i: int | None) -> Mask:
        """True for links that agent i sends or receives on, shape (l,)."""
        mask: Mask = (self.link_agents == (-1 if i is None else i)).any(axis=1)
        return mask


def _arrows(model: SceneModel, x: Array, inputs: list[tuple[float, ...]]) -> Array:
    """Each agent's input as an arrow, shape (N, 3); zero for an agent without one."""
    parts = model.kinematics.inputs
    u = np.zeros(parts[-1].stop)
    for part, values in zip(parts, inputs, strict=True):
        if values:
            u[part] = values
    return model.kinematics.effects(x, u)


def unsafe_lines(
    model: SceneModel, unsafe: list[int], violations: tuple[Violation, ...], x: Array, p: Array
) -> list[str]:
    """A line of text for each unsafe pair: its name, distance, h, and since when.

    x: the state, shape (n̄,). p: output points, shape (N, 3).
    """
    since = {v.pair: f", since t = {v.begin:.3f} s" for v in violations if v.end is None}
    texts = {model.label(pair): model.pair_text(pair, x, p) for pair in unsafe}
    return [
        f"{label} unsafe: {text} where 0 is allowed{since.get(label, '')}"
        for label, text in texts.items()
    ]


def past_lines(
    model: SceneModel, unsafe: list[int], violations: tuple[Violation, ...], t: float
) -> list[str]:
    """A line of text for each pair that was unsafe before t [s], and is not any more."""
    now = {model.label(pair) for pair in unsafe}
    return [
        f"{v.pair} was unsafe {f'{v.count} times, last ' if v.count > 1 else ''}"
        f"from t = {v.begin:.3f} s to {v.end:.3f} s"
        + (f", up to h = {v.worst:.3g}" if v.worst_at <= t else "")
        for v in violations
        if v.pair not in now and v.end is not None and v.end <= t
    ]


class Kind(Enum):
    """A kind of shape; the text says what its size means."""

    ARROW = auto()
    """Tail at its position, along x: length, and the head's width and height."""
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
    position: Array = _ORIGIN
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
    model: SceneModel, i: int, colour: Colour, position: Array = _ORIGIN, heading: Array = _AHEAD
) -> Iterator[Shape]:
    """An agent's arrow, name and safety radius, at a position; by default in its own frame."""
    body, reach = model.body, 2.0 * model.radius
    size = 2.0 * body, body, body
    yield Shape("agent", i, Kind.ARROW, colour, position - body * heading, heading, size)
    above = position + 1.5 * body * _UP
    yield Shape("name", i, Kind.TEXT, colour, above, size=(0.0, 0.0, body), text=model.names[i])
    if reach:
        kind, height = (Kind.DISC, _THIN) if model.flat else (Kind.BALL, reach)
        size = reach, reach, height
        yield Shape("safety radius", i, kind, colour, position, size=size, opacity=_FAINT)


def static_shapes(model: SceneModel) -> Iterator[Shape]:
    """Obstacles, walls, limits and the formation's path."""
    static = model.static
    for k, (center, radius) in enumerate(static.spheres):
        yield Shape("obstacle", k, Kind.BALL, OBSTACLE, center, size=(2.0 * radius,) * 3)
    thick, long = _WALL
    for k, (surface, normal) in enumerate(static.walls):
        position, size = surface + 0.5 * thick * normal, (thick, long, long)
        yield Shape("wall", k, Kind.BOX, OBSTACLE, position, normal, size, 2.0 * _FAINT)
    for k, line in enumerate(static.outlines):
        yield Shape("limit", k, Kind.LINE, OBSTACLE, points=line)
    if len(static.path):
        yield Shape("path", 0, Kind.LINE, OBSTACLE, points=static.path)
