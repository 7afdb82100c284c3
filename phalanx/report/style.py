"""The style of every figure: size, axes, legends, one colour for each agent; and its images."""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from phalanx.recording.curves.series import Envelope, Series, envelope, extremes
from phalanx.scenario.model import Scenario
from phalanx.theory.arrays import Array

_NORMAL = ("#1f5fbf", "#13a3b5", "#6a4fc4", "#0b3c6f", "#4aa8f0", "#1c8a6b")
_ADVERSARY = ("#d62728", "#8f0f2a", "#f2684a", "#e0559a")
DASHES = ("-", (0, (5, 1.5)), (0, (1.5, 1.2)), (0, (6, 1.5, 1.5, 1.5)), (0, (9, 3)))
WORST = ("#c1121f", "#e07b00", "#8f2fb3", "#111111")
"""Colours of the worst few, drawn over an envelope."""
NORMAL, ADVERSARY = "#1f5fbf", "#d62728"
"""Colours of a role as a whole."""
LIMIT, PEAK, MUTED = "#333333", "#c1121f", "#8a8f98"
MOST_NAMED = 12
"""Most entries of a legend, and most agents that are drawn one by one."""
FEW = 4
"""Number of the worst agents drawn by name where there are more than MOST_NAMED."""
WIDTH = 9.0
"""Of a figure [inch]."""
SMALL = 8.0
"""Size of legends and of many labels [pt]."""
_DPI = 110
_MARGIN = 0.1
"""Margin around the drawn part of a figure [inch]."""
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


def colours(scenario: Scenario) -> dict[str, str]:
    """Each agent's colour: normal agents blue, adversaries red, each its own shade."""
    chosen: dict[str, str] = {}
    for role, palette in (("normal", _NORMAL), ("adversary", _ADVERSARY)):
        names = [name for name, group, _ in scenario.roster() if group.role == role]
        chosen |= {name: palette[i % len(palette)] for i, name in enumerate(names)}
    return chosen


def summarises(scenario: Scenario) -> bool:
    """True if the report shows envelopes and the worst few instead of every agent."""
    return sum(group.size for group in scenario.agents) > MOST_NAMED


def panels(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    """Make a figure with a column of panels of this height [inch] that share their x axis."""
    figure = Figure(figsize=(WIDTH, rows * height + 0.3), layout="constrained", facecolor="white")
    axes = list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    for panel in axes:
        style_axes(panel)
    return figure, axes


def over_time(rows: int, height: float) -> tuple[Figure, list[Axes]]:
    """Make panels as panels() does, of curves over time."""
    figure, axes = panels(rows, height)
    axes[-1].set_xlabel("t [s]")
    for panel in axes:
        panel.margins(x=0.01)
    return figure, axes


def style_axes(axes: Axes) -> None:
    """Draw a light grid behind, and no frame above and to the right."""
    axes.grid(color="#000000", alpha=0.12, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def logarithmic(axes: Axes) -> None:
    """Make the y axis logarithmic, with plain numbers at 1, 2 and 5."""
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())


def title(axes: Axes, text: str, colour: str = "black") -> None:
    """Write a title above the right end of a panel."""
    axes.set_title(text, loc="right", color=colour, fontsize=10.0)


def legend(
    axes: Axes, title: str = "", most: int = MOST_NAMED, handles: Sequence[Artist] = ()
) -> None:
    """Name the first lines or handles to the right of the panel."""
    if handles := (handles or axes.get_legend_handles_labels()[0])[:most]:
        axes.legend(
            handles=handles, fontsize=SMALL, frameon=False, title=title, title_fontsize=SMALL,
            loc="upper left", bbox_to_anchor=(1.0, 1.02),
        )  # fmt: skip


def draw_line(
    axes: Axes, series: Series, *, colour: str, width: float = 0.8, stairs: bool = False,
    **looks: Any,
) -> None:  # fmt: skip
    """Draw a series through its extremes; stairs: as steps, each value until the next."""
    peaks = extremes(series.y)
    style = "steps-post" if stairs else "default"
    axes.plot(
        series.t[peaks], series.y[peaks], color=colour, linewidth=width, drawstyle=style, **looks
    )


def draw_envelope(axes: Axes, spread: Envelope, colour: str, of: str) -> None:
    """Draw an envelope as two bands, the wider one pale, and its median as a line."""
    t = spread.edges.ravel()
    least, low, middle, high, largest = np.repeat(spread.values, 2, axis=1)
    bands = (least, largest, 0.15, "least to largest"), (low, high, 0.3, "10 to 90 %")
    for below, above, alpha, text in bands:
        label = f"{of}: {text}"
        axes.fill_between(t, below, above, color=colour, alpha=alpha, linewidth=0.0, label=label)
    axes.plot(t, middle, color=colour, linewidth=1.4, label=f"{of}: median")


def draw_many(
    axes: Axes, curves: Mapping[str, Series], rank: Callable[[Array], Any], of: str, unit: str = ""
) -> None:
    """Draw the envelope of all agents' curves, and over it the few whose values rank lowest."""
    draw_envelope(axes, envelope(list(curves.values())), NORMAL, of)
    worst = sorted(curves, key=lambda name: rank(curves[name].y))
    for name, colour in zip(worst[:FEW], WORST, strict=False):
        y = curves[name].y
        label = f"{name}: {np.nanmin(y):.3g} to {np.nanmax(y):.3g}{unit}"
        draw_line(axes, curves[name], colour=colour, stairs=True, label=label)
    axes.margins(x=0.01)
    legend(axes)


def image_of(figure: Figure) -> bytes:
    """A figure as PNG, laid out and then cut to its drawn part.

    savefig alone can do both, but draws the whole figure once more to lay it out.
    """
    image = io.BytesIO()
    figure.dpi = _DPI
    renderer = FigureCanvasAgg(figure).get_renderer()
    if (layout := figure.get_layout_engine()) is not None:
        layout.execute(figure)
    figure.set_layout_engine()
    cut = figure.get_tightbbox(renderer).padded(_MARGIN)
    figure.savefig(image, format="png", dpi=_DPI, bbox_inches=cut)
    return image.getvalue()


def svg_of(draw: Callable[[], Figure]) -> bytes:
    """Draw a figure as SVG, without background."""
    file = io.StringIO()
    with mpl.rc_context(_SETTINGS):
        draw().savefig(file, format="svg", metadata=_NAMELESS, transparent=True)
    svg = file.getvalue()
    head, start, body = svg[svg.index("<svg") :].partition("<defs>")
    name = {light: f"--{light[1:]}" for light in DARK}
    body = _COLOUR.sub(lambda at: f"var({name[at[0]]})" if at[0] in name else at[0], start + body)
    light = "".join(f"{name[colour]}:{colour};" for colour in DARK)
    dark = "".join(f"{variable}:{DARK[colour]};" for colour, variable in name.items())
    style = (
        f"<style>:root{{{light}fill:var({name['#000000']})}}"
        f"@media (prefers-color-scheme:dark){{:root{{{dark}}}}}</style>"
    )
    return f"{head}{style}{body}".encode()
