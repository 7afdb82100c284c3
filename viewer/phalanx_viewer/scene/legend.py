"""The legend: the marks of the scene that a run has, and their meanings."""

from collections.abc import Iterable
from enum import Enum

from phalanx.messages.frames import Frame
from phalanx_viewer.scene import colours
from phalanx_viewer.scene.colours import COLOURS, Role
from phalanx_viewer.scene.model import SceneModel


class Mark(Enum):
    """A mark's text, sign and colour, in the legend's order; no colour: the text's own."""

    NORMAL = Role.NORMAL, "▲", COLOURS[Role.NORMAL]
    ADVERSARY = Role.ADVERSARY, "▲", COLOURS[Role.ADVERSARY]
    BACKUP = Role.BACKUP, "▲", COLOURS[Role.BACKUP]
    NO_AUTHORITY = Role.NO_AUTHORITY, "▲", COLOURS[Role.NO_AUTHORITY]
    SILENT = Role.SILENT, "▲", COLOURS[Role.SILENT]
    UNSAFE = "unsafe: h above 0", "◉", colours.DANGER
    LIE = "sent a false broadcast", "◎", colours.LIE
    GOAL = "goal", "∘", COLOURS[Role.NORMAL]
    CIRCLE = "circles touch where h = 0", "◯", colours.OBSTACLE
    CHOSEN = "chosen agent", "◯", None
    WORST_PAIR = "worst pair", "—", colours.WORST_PAIR
    LATE = "late link", "—", colours.LATE
    LOST = "lost link", "—", colours.DANGER
    APPLIED = "applied input", "→", None
    NOMINAL = "nominal input", "→", colours.OBSTACLE
    PATH = "recent path", "∿", colours.OBSTACLE
    OBSTACLE = "obstacle or limit", "■", colours.OBSTACLE
    FORMATION = "path of the formation's middle", "┄", colours.WORST_PAIR
    WIDTH = "width of the formation", "▒", colours.WORST_PAIR
    HEIGHT = "height over the ground", "┃", colours.OBSTACLE
    FRESH = "believed now", "◎", colours.FRESH
    HALF = "½ s ago", "◎", colours.LATE
    OLD = "1 s ago or more", "◎", colours.OLD


BELIEFS = {Mark.FRESH, Mark.HALF, Mark.OLD}


def legend(marks: Iterable[Mark]) -> list[tuple[str, str, str]]:
    """Return text, sign and colour, as in a style sheet, of each of these marks."""
    entries = [mark.value for mark in Mark if mark in marks]
    return [(text, sign, f"rgb{colour}" if colour else "") for text, sign, colour in entries]


def marks_of(model: SceneModel) -> set[Mark]:
    """Return the marks that a scenario's scene has from its start on."""
    static = model.static
    conditions = {
        Mark.NORMAL: not model.adversary.all(),
        Mark.ADVERSARY: model.adversary.any(),
        Mark.GOAL: model.has_goals,
        Mark.CIRCLE: model.radius > 0.0,
        Mark.OBSTACLE: any((static.spheres, static.walls, static.outlines)),
        Mark.FORMATION: len(static.path) > 0,
        Mark.WIDTH: model.flat and static.corridor > 0.0,
        Mark.HEIGHT: not model.flat,
    }
    always = {Mark.CHOSEN, Mark.WORST_PAIR, Mark.APPLIED, Mark.NOMINAL, Mark.PATH}
    return always | {mark for mark, holds in conditions.items() if holds}


def marks_in(frame: Frame) -> set[Mark]:
    """Return the marks that a frame, or its run before it, adds to those of the scenario."""
    statuses, events = frame.agents, frame.link_events
    conditions = {
        Mark.BACKUP: any(s.backups for s in statuses),
        Mark.NO_AUTHORITY: any(s.without_authority for s in statuses),
        Mark.UNSAFE: bool(frame.violations),
        Mark.LIE: any(s.lies for s in statuses),
        Mark.LATE: any(event.delay >= 0.0 for event in events),
        Mark.LOST: any(event.delay < 0.0 for event in events),
        Mark.SILENT: any(s.condition.silent for s in statuses),
        Mark.ADVERSARY: bool(frame.turned),
    }
    return {mark for mark, holds in conditions.items() if holds}
