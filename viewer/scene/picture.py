"""What one frame looks like: places, colours and arrows; the same for the page and for a PNG."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from phalanx.theory.rows.origin import Origin
from phalanx.viewer.scene.model import SceneModel, unit
from phalanx.wire.frames import AgentStatus, Condition, Frame

Array = NDArray[np.float64]
Colours = NDArray[np.uint8]


class Role(StrEnum):
    """How an agent is coloured."""

    NORMAL = "normal"
    ADVERSARY = "adversary"
    BACKUP = "backup"
    NO_AUTHORITY = "no authority"
    SILENT = "silent or dead"


COLOURS: dict[Role, tuple[int, int, int]] = {
    Role.NORMAL: (37, 99, 235),
    Role.ADVERSARY: (220, 38, 38),
    Role.BACKUP: (245, 158, 11),
    Role.NO_AUTHORITY: (192, 132, 252),
    Role.SILENT: (148, 163, 184),
}


@dataclass(frozen=True)
class Picture:
    """One frame, ready to draw; everything in 3-D and in metres."""

    t: float
    positions: Array
    """Output points, shape (N, 3)."""
    headings: Array
    """Unit vectors, shape (N, 3): where an agent faces, else where its input points, else zero."""
    roles: list[Role]
    applied: Array
    """Where the applied inputs point, shape (N, 3)."""
    u_nom: Array
    """Where the nominal inputs point, shape (N, 3)."""
    closest: tuple[Array, Array]
    """The ends of the pair closest to violation, shapes (3,)."""
    closest_text: str
    goals: Array
    """Formation centre and goals, shape (1 + g, 3)."""
    trouble: Array
    """Links that lost or delayed a broadcast, shape (l, 2, 3)."""
    trouble_lost: NDArray[np.bool_]
    """Which of them lost it, shape (l,)."""

    @property
    def colours(self) -> Colours:
        """Of the agents, shape (N, 3)."""
        return np.array([COLOURS[role] for role in self.roles], dtype=np.uint8)


def picture(cast: SceneModel, frame: Frame) -> Picture:
    """Work out what a frame looks like."""
    x = np.frombuffer(frame.x, dtype="<f8")
    places = cast.places(x)
    p = places.positions
    a, _ = cast.ends(frame.pair)
    ends = p[a], cast.other_end(frame.pair, p)
    h, distance = cast.h(frame.pair, x), float(np.linalg.norm(ends[0] - ends[1]))
    links = [(p[link.sender], p[link.receiver]) for link in frame.trouble]
    applied = cast.arrows(x, _stack(cast, [s.u for s in frame.agents]))
    faces = places.headings.any(axis=1, keepdims=True)
    return Picture(
        t=frame.t,
        positions=p,
        headings=np.where(faces, places.headings, unit(applied)),
        roles=[role(s, bool(bad)) for s, bad in zip(frame.agents, cast.adversary, strict=True)],
        applied=applied,
        u_nom=cast.arrows(x, _stack(cast, [s.u_nom for s in frame.agents])),
        closest=ends,
        closest_text=f"{cast.label(frame.pair)}: {distance:.2f} m, h = {h:.3g}",
        goals=cast.goals(frame.t),
        trouble=np.array(links).reshape(-1, 2, 3),
        trouble_lost=np.array([link.delay < 0.0 for link in frame.trouble], dtype=bool),
    )


def role(shown: AgentStatus, adversary: bool) -> Role:
    """How to colour an agent."""
    if shown.condition in (Condition.DEAD, Condition.FROZEN):
        return Role.SILENT
    if adversary or shown.condition == Condition.TURNED:
        return Role.ADVERSARY
    if shown.origin == Origin.BACKUP:
        return Role.BACKUP
    return Role.NO_AUTHORITY if shown.origin == Origin.NO_AUTHORITY else Role.NORMAL


def _stack(cast: SceneModel, inputs: list[tuple[float, ...]]) -> Array:
    """All inputs as one vector; zero for an agent without one."""
    u = np.zeros(cast.inputs[-1].stop)
    for held, given in zip(cast.inputs, inputs, strict=True):
        if given:
            u[held] = given
    return u
