"""Limits of `guaranteed` in α, φ, Γ, loss and delay, one at a time, as a table and a picture.

    python evidence/paper/frontier.py [--seeds 2] [--duration 8] [--out docs/images/frontier.png]

Around the shipped scenario (φ^max 1.73, α = 20, 10 ± 2 ms, 30 % loss, delays to 0.1 s), with the
`local` and with the `integrated` margin. Only the last metres of its path, slowly, in a formation
of 3 m radius: the pursuers are at the normal agents from the third second on. Cost is the mean of
‖u - u_nom‖² over the normal agents' steps, in the QP's metric; the line to compare it with is the
same scenario with the paper's η and α, which prove nothing.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track
from variants import Measured, measure, simulated

from phalanx.guarantee.verdict import Outcome
from phalanx.report.style import MUTED, style_axes

MARGINS = {"local": "#d62728", "integrated": "#1f5fbf"}
BESET = [
    "formation.path=[[32.0,-3.0],[35.0,-3.0],[38.0,-1.5],[40.0,0.0]]",
    "formation.finish=5.0",
    "formation.radius=3.0",
]
UNPROVEN = ["safety.margin=paper", "safety.eta=8.0566", "safety.alpha=[2.0]"]
JITTER, SERVES = 0.2, 0.25
"""δ^max as a share of Γ; κ τ of the α that goes with a Γ."""


def _alpha(gain: float) -> list[str]:
    return [f"safety.alpha=[{gain}]"]


def _disturbance(bound: float) -> list[str]:
    return [f"agents.{group}.disturbance.bound={bound}" for group in (0, 1)]


def _period(milliseconds: float) -> list[str]:
    period = milliseconds / 1e3
    clock = f"{{period={period}, jitter={JITTER * period}}}"
    clocks = [f"agents.{group}.clock={clock}" for group in (0, 1)]
    return [*clocks, *_alpha(SERVES / (period * (1 + JITTER)))]


def _delay(longest: float) -> list[str]:
    return [f"network.delay={{low=0.0, high={longest}}}"]


class Axis(NamedTuple):
    """One parameter that is varied."""

    name: str
    values: tuple[float, ...]
    shipped: float
    overrides: Callable[[float], list[str]]


AXES = (
    Axis("α [1/s]", (5.0, 10.0, 20.0, 50.0), 20.0, _alpha),
    Axis("φ^max", (0.5, 1.73, 3.5), 1.73, _disturbance),
    Axis("Γ [ms], α = 0.25/τ", (10.0, 20.0, 40.0), 10.0, _period),
    Axis("loss", (0.3, 0.9), 0.3, lambda share: [f"network.loss={share}"]),
    Axis("longest delay [s]", (0.1, 0.9), 0.1, _delay),
)


class Point(NamedTuple):
    """All seeds of one value with one margin."""

    guaranteed: int
    runs: int
    empty: float
    """Share of steps whose K_i was empty."""
    cost: float


def main() -> None:
    """Run the grid, print a line for each point as it is known, and draw the picture."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    arguments.add_argument("--seeds", type=int, default=2)
    arguments.add_argument("--duration", type=float, default=8.0)
    arguments.add_argument("--out", type=Path, default=Path("docs/images/frontier.png"))
    options = arguments.parse_args()
    cache: dict[tuple[str, ...], Point] = {}

    def point(*overrides: str) -> Point:
        if overrides not in cache:
            common = [*BESET, f"duration={options.duration}", *overrides]
            runs = [measure(simulated("guaranteed", common, s)) for s in range(options.seeds)]
            cache[overrides] = summed(runs)
        return cache[overrides]

    print("| varied | value | margin | guaranteed | empty K_i | cost |\n|---|---|---|---|---|---|")
    unproven = point(*UNPROVEN)
    print(line("-", "-", "none proven", unproven), flush=True)
    points: dict[tuple[str, str], list[Point]] = {}
    for axis, value, margin in track(list(_grid()), console=Console(stderr=True)):
        # The shipped value is every axis' own: one run for all of them.
        varied = [] if value == axis.shipped else axis.overrides(value)
        sums = point(f"safety.margin={margin}", *varied)
        points.setdefault((axis.name, margin), []).append(sums)
        print(line(axis.name, f"{value:g}", margin, sums), flush=True)
    picture(points, unproven).savefig(options.out, dpi=110)


def _grid() -> Iterator[tuple[Axis, float, str]]:
    for axis in AXES:
        for value in axis.values:
            for margin in MARGINS:
                yield axis, value, margin


def summed(runs: list[Measured]) -> Point:
    """Summarize the runs of one point."""
    guaranteed = sum(run.outcome == Outcome.GUARANTEED for run in runs)
    empty, cost = np.mean([(run.backup, run.cost) for run in runs], axis=0).tolist()
    return Point(guaranteed, len(runs), empty, cost)


def line(varied: str, value: str, margin: str, point: Point) -> str:
    """One line of the table."""
    verdicts = f"{point.guaranteed} of {point.runs}"
    return f"| {varied} | {value} | {margin} | {verdicts} | {point.empty:.2%} | {point.cost:.2f} |"


def picture(results: dict[tuple[str, str], list[Point]], unproven: Point) -> Figure:
    """A column for each parameter: cost above, share of empty K_i below; hollow: not guaranteed."""
    figure = Figure(figsize=(13.0, 5.0), layout="constrained", facecolor="white")
    grid = figure.subplots(2, len(AXES), sharex="col", sharey="row", squeeze=False)
    for column, axis in enumerate(AXES):
        cost, empty = grid[:, column]
        for margin, colour in MARGINS.items():
            points = results[axis.name, margin]
            proven = [p.guaranteed == p.runs for p in points]
            _draw(cost, axis.values, [p.cost for p in points], proven, colour, margin)
            _draw(empty, axis.values, [100 * p.empty for p in points], proven, colour, margin)
        cost.axhline(unproven.cost, color=MUTED, linestyle="--", label="paper's η and α")
        cost.axvline(axis.shipped, color=MUTED, linewidth=0.6)
        empty.axvline(axis.shipped, color=MUTED, linewidth=0.6)
        empty.set_xlabel(axis.name)
    grid[0, 0].set_ylabel("cost, mean ‖u − u_nom‖²")
    grid[1, 0].set_ylabel("empty K_i [%]")
    grid[0, 0].legend(fontsize=8, frameon=False, title="hollow: not guaranteed", title_fontsize=8)
    return figure


def _draw(
    axes: Axes,
    x: tuple[float, ...],
    y: list[float],
    proven: list[bool],
    colour: str,
    name: str,
) -> None:
    style_axes(axes)
    axes.plot(x, y, color=colour, label=name)
    faces = [colour if each else "white" for each in proven]
    axes.scatter(x, y, color=faces, edgecolors=colour, zorder=3)


if __name__ == "__main__":
    main()
