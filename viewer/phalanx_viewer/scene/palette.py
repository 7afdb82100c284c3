"""Colours of the scene on a light page and on a dark one."""

from typing import NamedTuple

Colour = tuple[int, int, int]

DANGER: Colour = (225, 29, 46)
WORST_PAIR: Colour = (22, 163, 74)
LATE: Colour = (245, 158, 11)
LIE: Colour = (6, 182, 212)
OBSTACLE: Colour = (100, 116, 139)


class Palette(NamedTuple):
    """Colours that depend on the page's."""

    background: Colour
    ink: Colour
    faint: Colour
    cells: Colour
    sections: Colour


LIGHT = Palette((255, 255, 255), (15, 23, 42), (148, 163, 184), (236, 239, 243), (212, 218, 226))
DARK = Palette((20, 21, 23), (226, 232, 240), (100, 116, 139), (38, 41, 46), (58, 63, 71))
