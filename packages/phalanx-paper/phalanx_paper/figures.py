"""The paper's figures by their numbers: what each says, and how it is drawn."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from phalanx.recording.curves.history import EMPTY_CODES, ReportHistory
from phalanx.report.paths import draw_scene
from phalanx.report.safety import required_distance, safety
from phalanx.report.steps import inputs
from phalanx.report.style import ADVERSARY, NORMAL
from phalanx.theory.rows.origin import Origin
from phalanx_paper.runs import Finished

_MAGENTA = "#d10fd1"
_STILLS = (0.25, 0.5, 0.75)
"""When, as shares of the run; the paper gives no times."""
_WIDTH = 4.2
"""Of a still [inch]."""
Claim = tuple[str, bool]
"""What came of a run, and whether the paper says the same."""


class PaperFigure(NamedTuple):
    """A figure of the paper, by its number there."""

    number: int
    title: str
    says: str
    """What the paper says of it."""
    cases: tuple[str, ...]
    """One picture for each."""
    draw: Callable[[Finished], Figure]
    claim: Callable[[Finished], Claim] | None = None
    more: tuple[str, ...] = ()
    """Cases that the paper has not."""


def _stills(finished: Finished, shares: Sequence[float] = _STILLS) -> Figure:
    """Draw agents and goals at shares of the run, from above; in space also from one side."""
    history = finished.history
    planes = [(0, 1), (0, 2)][: history.positions.shape[2] - 1]
    size = _WIDTH * len(shares), _WIDTH * len(planes)
    figure = Figure(size, layout="compressed", facecolor="white")
    grid = figure.subplots(len(planes), len(shares), squeeze=False)
    for row, plane in zip(grid, planes, strict=True):
        for axes, share in zip(row, shares, strict=True):
            draw_scene(axes, history, plane)
            _draw_moment(axes, history, plane, share * history.times[-1])
    return figure


def _draw_moment(axes: Axes, history: ReportHistory, plane: tuple[int, int], t: float) -> None:
    state = int(np.searchsorted(history.times, t, side="right")) - 1
    axes.set_title(f"t = {history.times[state]:.1f} s", fontsize=10)
    scenario, points = history.scenario, history.positions[state][:, plane]
    radius = required_distance(scenario)
    for (name, group, k), p in zip(scenario.roster(), points, strict=True):
        normal = group.role == "normal"
        axes.plot(*p, "o", color=NORMAL if normal else ADVERSARY, markersize=5, zorder=3)
        axes.annotate(name, p, xytext=(4, 3), textcoords="offset points", fontsize=8)
        if normal and radius:
            axes.add_patch(Circle(tuple(p), radius, fill=False, ls=":", edgecolor=ADVERSARY))
        if group.slots and scenario.formation:
            goal = scenario.formation.goal(group.slots[k], t).position[list(plane)]
            axes.plot(*goal, "x", color="black", markersize=5)
    if scenario.formation:
        centre = scenario.formation.center(t).position[list(plane)]
        axes.plot(*centre, "D", color=_MAGENTA, markersize=5)


def _crosses_zero(finished: Finished, crosses: bool = True) -> Claim:
    h = finished.summary.largest_h_tot
    return f"largest h_tot {h:.4g}", (h > 0.0) == crosses


def _keeps_bounds(finished: Finished) -> Claim:
    """Return the steps at which the backup was used; all inputs have to be admissible."""
    empty = finished.history.agent(finished.shown_agent).empty
    backups = int((empty == EMPTY_CODES[Origin.BACKUP]).sum())
    bounds = next(a for a in finished.summary.assumptions if a.name == "admissible inputs")
    words = f"backup at {backups} of {len(empty)} steps, {bounds.failed} inputs out of bounds"
    return words, backups > 0 and not bounds.failed


FIGURES = (
    PaperFigure(
        1, "Starts at which no safe input remains",
        "Adversaries surround a normal agent, or pin it against an obstacle: K_i cannot be kept "
        "non-empty.",
        ("surrounded", "pinned"), partial(_stills, shares=(0.0,)), _crosses_zero,
    ),
    PaperFigure(
        2, "Still frames of Simulation 1",
        "Blue: normal agents, with the distance that they keep; red: adversaries; dashed: path of "
        "the formation, its centre a diamond; crosses: agents' goals.",
        ("1",), _stills,
    ),
    PaperFigure(
        3, "h_tot in Simulation 1", "Not above zero: normal agents stay safe.",
        ("1",), lambda f: safety(f.history), partial(_crosses_zero, crosses=False),
    ),
    PaperFigure(
        4, "h_tot in Simulation 1 with η = 0", "Above zero for a while: the safe set is left.",
        ("1, η = 0",), lambda f: safety(f.history), _crosses_zero,
    ),
    PaperFigure(
        5, "Inputs of agent 2 in Simulation 1",
        "Within their bounds; red crosses where the worst-case LP, the backup, is used.",
        ("1",), lambda f: inputs(f.history, f.shown_agent), _keeps_bounds,
    ),
    PaperFigure(6, "Still frames of Simulation 2", "As figure 2, in space.", ("2",), _stills),
    PaperFigure(
        7, "h_tot in Simulation 2",
        "Strictly negative throughout. Below it, what the paper has not: without margins, and with "
        "the drag as printed.",
        ("2",), lambda f: safety(f.history), partial(_crosses_zero, crosses=False),
        ("2, η = 0", "2, β = 3"),
    ),
    PaperFigure(
        8, "Inputs of agent 2 in Simulation 2",
        "The infinity norm within its bound; red crosses where the backup is used.",
        ("2",), lambda f: inputs(f.history, f.shown_agent), _keeps_bounds,
    ),
)  # fmt: skip
"""In the paper's order."""
