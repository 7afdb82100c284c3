"""Figures as SVG that turn dark with the page."""

import io
import re
from collections.abc import Callable

import matplotlib as mpl
from matplotlib.figure import Figure

DARK = {
    "#000000": "#e4e7eb",
    "#333333": "#c9ced6",
    "#1f5fbf": "#7fb0ff",
    "#1a7f46": "#4cc07f",
    "#a86a00": "#e5a63c",
    "#c1121f": "#ff6b73",
    "#5d6570": "#9aa3ae",
    "#8f2fb3": "#c98be6",
}
"""The colour on a dark page of each that is drawn on a light one; others stay."""

# Texts come from rows: they are never formulas. They stay texts, and the same rows give one file.
_SETTINGS = {"svg.fonttype": "none", "svg.hashsalt": "phalanx", "text.parse_math": False}
_NAMELESS = {"Date": None, "Creator": None}
_COLOUR = re.compile(r"(?<=fill: |roke: )#[0-9a-f]{6}")


def svg_of(draw: Callable[[], Figure]) -> bytes:
    """Draw a figure as SVG, without background."""
    file = io.StringIO()
    with mpl.rc_context(_SETTINGS):
        draw().savefig(file, format="svg", metadata=_NAMELESS, transparent=True)
    svg = file.getvalue()
    head, start, body = svg[svg.index("<svg") :].partition("<defs>")
    name = {light: f"--{light[1:]}" for light in DARK}
    body = _COLOUR.sub(lambda at: f"var({name[at[0]]})" if at[0] in name else at[0], start + body)
    light = "".join(f"{name[each]}:{each};" for each in DARK)
    dark = "".join(f"{name[each]}:{DARK[each]};" for each in DARK)
    style = (
        f"<style>:root{{{light}fill:var({name['#000000']})}}"
        f"@media (prefers-color-scheme:dark){{:root{{{dark}}}}}</style>"
    )
    return f"{head}{style}{body}".encode()
