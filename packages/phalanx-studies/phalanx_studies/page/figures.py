"""The figures of a study, from groups of its runs."""

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from phalanx.guarantee.verdict import Outcome
from phalanx.network.draws import Draws
from phalanx.report.style import LIMIT, NORMAL, PEAK, legend, panels
from phalanx.theory.arrays import Array
from phalanx_studies.page.groups import Group, in_percent
from phalanx_studies.statistics import dkw_band

_LOOKS = {
    Outcome.GUARANTEED: ("#1a7f46", "o"),
    Outcome.SAFE: ("#a86a00", "s"),
    Outcome.VIOLATED: (PEAK, "X"),
    Outcome.BROKEN: ("#5d6570", "D"),
    Outcome.STOPPED: ("#8f2fb3", "^"),
}
_CURVES = (NORMAL, PEAK, "#1a7f46", "#a86a00")
"""One colour for each distribution."""
_MOST_STEPS = 400
"""Most steps of a curve that are drawn."""
_LONGEST = 22
"""Most letters of a label."""
_PALE, _DEEP = "#fffffe", "#101010"
"""Texts on dark and on light cells, on a page of any colour."""


def short(label: str, most: int = _LONGEST) -> str:
    """Return a label of so many letters at most, all of which can be printed."""
    plain = "".join(letter if letter.isprintable() else " " for letter in label)
    return plain if len(plain) <= most else plain[: most - 1] + "…"


def rates_figure(axis: str, groups: Sequence[Group], outcomes: Sequence[str]) -> Figure:
    """Draw the rate of each outcome with its interval, over the values of an axis."""
    figure, (axes,) = panels(1, 3.2)
    for number, outcome in enumerate(outcomes):
        points = [(i, group.rates[outcome]) for i, group in enumerate(groups) if len(group.rows)]
        share = np.array([rate.share for _, rate in points])
        ends = np.array([rate.interval for _, rate in points]).T
        x = np.array([i for i, _ in points]) + 0.09 * (number - (len(outcomes) - 1) / 2)
        colour, marker = _LOOKS[Outcome(outcome)]
        # Betting may leave the observed mean just outside.
        reach = np.maximum([share - ends[0], ends[1] - share], 0.0)
        axes.errorbar(x, share, reach, color=colour, fmt=marker, capsize=2, label=outcome)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_ylim(-0.03, 1.03)
    _name(axes, "x", axis, [group.label for group in groups])
    legend(axes)
    return figure


def heat_figure(
    names: tuple[str, str], labels: tuple[Sequence[str], Sequence[str]],
    cells: Mapping[tuple[int, int], Group], outcome: str,
) -> Figure:  # fmt: skip
    """Draw an outcome's rate over two axes, each cell with its interval."""
    columns, rows = map(len, labels)
    figure, (axes,) = panels(1, 1.2 + 0.42 * rows)
    axes.grid(False)
    axes.set_xlim(-0.5, columns - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    for (i, j), cell in cells.items():
        share, (low, high), _ = cell.rates[outcome]
        colour = colormaps["viridis"](share)
        axes.fill_between([i - 0.48, i + 0.48], j - 0.46, j + 0.46, color=colour, linewidth=0.0)
        text = f"{in_percent(share)} %"
        if columns <= 8:
            text += f"\n{in_percent(low)} to {in_percent(high)}"
        ink = _DEEP if share > 0.6 else _PALE
        axes.text(i, j, text, ha="center", va="center", fontsize=8.0, color=ink)
    _name(axes, "x", names[0], labels[0])
    _name(axes, "y", names[1], labels[1])
    return figure


def distribution_figure(groups: Sequence[Group]) -> Figure:
    """Draw the distribution of the worst h, with a band that holds everywhere at once."""
    figure, (axes,) = panels(1, 3.2)
    for group, colour in zip(groups, _CURVES, strict=False):
        values = one_of_each_seed(group.rows)
        band = dkw_band(values)
        if not len(values):
            continue
        steps = np.unique(np.linspace(0, len(values) - 1, _MOST_STEPS).astype(int))
        x, share, low, high = (part[steps] for part in band)
        label = f"{short(group.label)}: {len(values)} runs"
        axes.step(x, share, where="post", color=colour, linewidth=1.4, label=label)
        axes.fill_between(x, low, high, step="post", color=colour, alpha=0.18, linewidth=0.0)
    _safety(axes)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.set_ylabel("runs at or below")
    legend(axes)
    return figure


def one_of_each_seed(runs: pl.DataFrame) -> Array:
    """Return independent values of the worst h: one run's of each seed, drawn by the seed.

    Runs under one seed only are independent already.
    """
    ended = runs.drop_nulls("worst_h")
    of_seed = ended.group_by("seed", maintain_order=True).agg("worst_h")
    if len(of_seed) <= 1:
        return ended["worst_h"].to_numpy()
    chosen = [
        values[int(len(values) * Draws(seed, "run of a seed").value(0))]
        for seed, values in of_seed.iter_rows()
    ]
    return np.array(chosen)


def _safety(axes: Axes) -> None:
    """Name the x axis, and draw its zero unless that would press the rest together."""
    axes.set_xlabel("worst h: unsafe above 0")
    low, high = axes.get_xlim()
    if low - (high - low) < 0.0 < high + (high - low):
        axes.axvline(0.0, color=LIMIT, linewidth=1.2)


def _name(axes: Axes, side: str, axis: str, labels: Sequence[str]) -> None:
    """Write the axis' name and its values at 0, 1, ..."""
    names = [short(label) for label in labels]
    turned = side == "x" and sum(map(len, names)) > 70
    turn = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if turned else {}
    axes.set(**{f"{side}label": short(axis, 3 * _LONGEST)})
    getattr(axes, f"set_{side}ticks")(range(len(names)), names, **turn)
