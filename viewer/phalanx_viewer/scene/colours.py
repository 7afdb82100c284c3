"""Colours of agents by their role, of other marks, and of light and dark pages."""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from phalanx.faults.commands import Condition
from phalanx.messages.frames import AgentStatus
from phalanx.theory.rows.origin import Origin

Colour = tuple[int, int, int]

DANGER: Colour = (225, 29, 46)
WORST_PAIR: Colour = (22, 163, 74)
LATE: Colour = (245, 158, 11)
LIE: Colour = (6, 182, 212)
OBSTACLE: Colour = (100, 116, 139)
FRESH: Colour = (13, 170, 155)
OLD: Colour = (219, 39, 119)
_AGES = 0.0, 0.5, 1.0
"""Of what is drawn in the colours of the fresh, the late and the old [s]."""


class Palette(NamedTuple):
    """Colours that differ between a light and a dark page."""

    background: Colour
    ink: Colour
    faint: Colour
    cells: Colour
    sections: Colour


LIGHT = Palette((255, 255, 255), (15, 23, 42), (148, 163, 184), (236, 239, 243), (212, 218, 226))
DARK = Palette((20, 21, 23), (226, 232, 240), (100, 116, 139), (38, 41, 46), (58, 63, 71))


class Role(StrEnum):
    """An agent's role as its colour shows it."""

    NORMAL = "normal"
    ADVERSARY = "adversary"
    BACKUP = "backup"
    NO_AUTHORITY = "no authority"
    SILENT = "silent or dead"


COLOURS: dict[Role, Colour] = {
    Role.NORMAL: (29, 78, 216),
    Role.ADVERSARY: (205, 20, 32),
    Role.BACKUP: (234, 115, 0),
    Role.NO_AUTHORITY: (126, 50, 230),
    Role.SILENT: (120, 130, 145),
}


def role(status: AgentStatus, adversary: bool) -> Role:
    """An agent's role now; adversary: whether it was one from the start."""
    if status.condition.silent:
        return Role.SILENT
    if adversary or status.condition == Condition.TURNED:
        return Role.ADVERSARY
    origin = status.step.origin if status.step else None
    if origin == Origin.BACKUP:
        return Role.BACKUP
    return Role.NO_AUTHORITY if origin == Origin.NO_AUTHORITY else Role.NORMAL


def age_colour(age: float) -> Colour:
    """The colour of a state that was sampled so long ago [s]."""
    stops = zip(FRESH, LATE, OLD, strict=True)
    red, green, blue = (round(float(np.interp(age, _AGES, channel))) for channel in stops)
    return red, green, blue
