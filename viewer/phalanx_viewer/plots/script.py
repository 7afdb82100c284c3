"""The script that draws plots and timeline in a browser, the same on every page."""

import functools
import json
from importlib.resources import files

PARTS = ("state.js", "lanes.js", "plots.js", "timeline.js", "keys.js")
"""Functions of one scope: each part uses those before it."""


@functools.cache
def script() -> str:
    """Source that adds the panels to a page, and `phalanx` to its window.

    phalanx.show(content) draws a Content, phalanx.at({t, playing, speed}) moves the cursor, and
    phalanx.act is called with {seek: t}, {play: true or false} or {speed: factor}.
    """
    here = files(__package__)
    style = json.dumps(here.joinpath("panels.css").read_text("utf-8"))
    parts = "\n".join(here.joinpath(part).read_text("utf-8") for part in PARTS)
    # A page that lost its connection for a while is sent everything again.
    return f"if (!window.phalanx) (() => {{\nconst STYLE = {style};\n{parts}\n}})();"
