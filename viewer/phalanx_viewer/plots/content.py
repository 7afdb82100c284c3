"""Curves, bands and marks as a page's plots and timeline show them, and the script that does."""

import functools
import json
from importlib.resources import files

import msgspec


class Curve(msgspec.Struct, omit_defaults=True):
    """A line in a plot, or with `to` the band between two lines."""

    t: list[float]
    """[s]"""
    y: list[float]
    to: list[float] | None = None
    """The band's other edge."""
    name: str = ""
    agent: int | None = None
    """Whose it is: bold when that agent is chosen."""
    role: str = ""
    """How it is drawn otherwise: "chosen" bold, "guide" dashed, by default pale."""


class Lane(msgspec.Struct):
    """One agent in a space-time diagram: a digit for each interval of the run."""

    late: str
    """Share of the broadcasts to it that came too late for its next step: 0 none, 9 all."""
    lost: str
    """Likewise of those that were lost."""
    state: str
    """How it did: a place in LANE_STATES."""
    false: str
    """Whether it sent a false broadcast: 0 or 1."""


FALSE = "false"
"""The fate in a Zoom of a false broadcast."""


class Zoom(msgspec.Struct):
    """A few control steps around the worst moment, broadcast by broadcast."""

    begin: float
    """[s]"""
    end: float
    """[s]"""
    steps: list[list[float]]
    """When each agent had its steps [s]."""
    broadcasts: list[tuple[int, float, int, float, str]]
    """Of each its sender, when it was sent, its receiver, when it arrived [s], and its fate."""


class Plot(msgspec.Struct):
    """One plot; times run from the run's begin to its end."""

    title: str
    unit: str
    curves: list[Curve]
    safe: tuple[float | None, float | None] = (None, None)
    """Between which values all is well; beyond them the plot is shaded."""
    logarithmic: bool = False
    of_agents: bool = False
    """Whether the chosen agent's backup periods are shown; else everybody's faults."""
    agent: int | None = None
    """Shown only when that agent is chosen; null: always."""
    lanes: list[Lane] = []
    """A space-time diagram, instead of curves."""
    zoom: Zoom | None = None
    """Its worst moment; of a recorded run."""


class Period(msgspec.Struct):
    """From when to when an agent was on its backup, without authority, or not fine."""

    agent: int
    kind: str
    """An Origin or a Condition."""
    begin: float
    """[s]"""
    end: float
    """[s]"""


class Mark(msgspec.Struct):
    """A moment worth jumping to."""

    t: float
    """[s]"""
    text: str
    kind: str = "log"
    """What it is drawn as: "worst", "backup", "violation", "fault" or "log"."""


class Content(msgspec.Struct):
    """Everything the page's script draws."""

    title: str
    begin: float
    """[s]"""
    end: float
    """[s]"""
    step: float
    """By how much an arrow key moves the cursor [s]."""
    seekable: bool
    """Whether the cursor can be put elsewhere; else it is where the run is."""
    agents: list[str]
    adversaries: list[bool]
    chosen: int
    pair: int
    """The pair whose h is bold."""
    plots: list[Plot]
    periods: list[Period]
    marks: list[Mark]


_PARTS = ("state.js", "lanes.js", "plots.js", "timeline.js", "keys.js")
"""Functions of one scope: each part uses those before it."""


@functools.cache
def script() -> str:
    """Source that adds the panels to a page, and `phalanx` to its window.

    phalanx.show(content) draws a Content, phalanx.at({t, playing, speed}) moves the cursor, and
    phalanx.act is called with {seek: t}, {play: true or false} or {speed: factor}.
    """
    here = files(__package__)
    style = json.dumps(here.joinpath("panels.css").read_text("utf-8"))
    parts = "\n".join(here.joinpath(part).read_text("utf-8") for part in _PARTS)
    # A page that lost its connection for a while is sent everything again.
    return f"if (!window.phalanx) (() => {{\nconst STYLE = {style};\n{parts}\n}})();"
