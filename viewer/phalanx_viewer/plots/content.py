"""Curves, bands and marks of a page's plots and timeline, and the script that draws them.

All times are in seconds.
"""

import functools
import json
from importlib.resources import files

import msgspec


class Curve(msgspec.Struct, omit_defaults=True):
    """A line in a plot, or with `to` the band between two lines."""

    t: list[float]
    y: list[float]
    to: list[float] | None = None
    """The band's other edge."""
    name: str = ""
    agent: int | None = None
    """The agent that it belongs to: bold when that is chosen."""
    role: str = ""
    """Style otherwise: "chosen" bold, "guide" dashed, by default pale."""


class Lane(msgspec.Struct):
    """One agent in a space-time diagram: a digit for each interval of the run."""

    late: str
    """Share of the broadcasts to it that came too late for its next step: 0 none, 9 all."""
    lost: str
    """Share of the broadcasts to it that were lost."""
    state: str
    """Its gravest state: a place in LANE_STATES."""
    false: str
    """1 if it sent a false broadcast, else 0."""


FALSE = "false"
"""The fate in a Zoom of a false broadcast."""


class Zoom(msgspec.Struct):
    """A few control steps around the worst moment, broadcast by broadcast."""

    begin: float
    end: float
    steps: list[list[float]]
    """Times of each agent's steps."""
    broadcasts: list[tuple[int, float, int, float, str]]
    """Sender, time sent, receiver, time of arrival and fate of each."""


class Plot(msgspec.Struct):
    """One plot; times run from the run's begin to its end."""

    title: str
    unit: str
    curves: list[Curve]
    safe: tuple[float | None, float | None] = (None, None)
    """Least and largest safe value; beyond them the plot is shaded."""
    logarithmic: bool = False
    of_agents: bool = False
    """If true, the chosen agent's backup periods are shown; else all agents' faults."""
    agent: int | None = None
    """Shown only when that agent is chosen; null: always."""
    lanes: list[Lane] = []
    """A space-time diagram, instead of curves."""
    zoom: Zoom | None = None
    """The worst moment of a recorded run."""


class Period(msgspec.Struct):
    """A period in which an agent was on its backup, without authority, or not fine."""

    agent: int
    kind: str
    """An Origin or a Condition."""
    begin: float
    end: float


class Mark(msgspec.Struct):
    """A moment worth jumping to."""

    t: float
    text: str
    kind: str = "log"
    """Its kind: "worst", "backup", "violation", "fault" or "log"."""


class Content(msgspec.Struct):
    """Everything the page's script draws."""

    title: str
    begin: float
    end: float
    step: float
    """Time by which an arrow key moves the cursor."""
    seekable: bool
    """If true, visitors can move the cursor; else it follows the run."""
    agents: list[str]
    adversaries: list[bool]
    chosen: int
    pair: int
    """The pair whose h is bold."""
    plots: list[Plot]
    periods: list[Period]
    marks: list[Mark]


_PARTS = ("state.js", "plots.js", "timeline.js", "keys.js")
"""Functions of one scope: each part uses those before it."""


@functools.cache
def script() -> str:
    """JavaScript that adds the panels to a page, and `phalanx` to its window.

    phalanx.show(content) draws a Content, phalanx.at({t, playing, speed}) moves the cursor, and
    phalanx.act is called with {seek: t}, {play: true or false} or {speed: factor}.
    """
    here = files(__package__)
    style = json.dumps(here.joinpath("panels.css").read_text("utf-8"))
    parts = "\n".join(here.joinpath(part).read_text("utf-8") for part in _PARTS)
    # A page that lost its connection for a while receives everything again.
    return f"if (!window.phalanx) (() => {{\nconst STYLE = {style};\n{parts}\n}})();"
