"""The page of a search: its curve next to that of random search, and its archive."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from phalanx.attacks.archive import Behaviour, Find, table_of
from phalanx.attacks.robustness import evaluate
from phalanx.attacks.search import History, Search
from phalanx.report.html import drawing, note, save_page, section, sortable, table
from phalanx.report.style import ADVERSARY, NORMAL, PEAK, current, legend, panels, style_axes
from phalanx.scenario.load import load
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array

_HEIGHT = 3.0
"""[inch]"""
_COLOURS = (NORMAL, "#5d6570")
_MOST = 200


def write_attack_page(
    search: Search, finds: Sequence[tuple[Behaviour, Find, Path]], path: Path
) -> Path:
    """Write one HTML file that needs no other; return its path. Raises OSError."""
    name = str(search.space.table.get("name", "attack"))
    histories = [history for history in search.histories if history.finds]
    parts = []
    if histories:
        curve = drawing(_CURVE, partial(search_figure, histories))
        parts.append(section("Search", curve + table(*counts(histories))))
        files = {find.row.trajectory: file for _, find, file in finds}
        archived = search.archive.best_first
        parts.append(section("Archive: the best attack of each behaviour", _table(archived, files)))
        if archived:
            parts.append(section("The best attack", _best(search, archived[0][1], files)))
    else:
        parts.append(note("No run yet."))
    return save_page(path, f"Attacks on {name}", parts, about=_INTRODUCTION)


_INTRODUCTION = (
    "A search changed some fields of the scenario, within bounds, to bring a pair of agents as "
    "close as possible to h > 0, where it is unsafe."
)
_CURVE = (
    "The least robustness after each run. Below 0 a pair was unsafe, below 1 it was without a "
    "certificate, above 1 it was under one throughout."
)


def search_figure(histories: Sequence[History]) -> Figure:
    """Draw the least robustness over the number of runs, of each optimiser."""
    figure, (axes,) = panels(1, _HEIGHT)
    for history, colour in zip(histories, _COLOURS, strict=False):
        least = np.minimum.accumulate([find.robustness for find in history.finds])
        runs = np.arange(1, len(least) + 1)
        axes.step(runs, least, where="post", color=colour, label=history.optimiser)
    axes.axhline(0.0, color=PEAK, linewidth=1.0, linestyle="--")
    axes.set_xlabel("runs")
    axes.set_ylabel("least robustness")
    legend(axes)
    return figure


def counts(histories: Sequence[History]) -> tuple[Sequence[str], list[Sequence[str]]]:
    """Return how many runs each optimiser made, and what they gave: titles, and a row of each."""
    head = ("optimiser", "runs", "repeated", "refused", "least robustness", "violated", "first at")
    rows: list[Sequence[str]] = [
        (
            history.optimiser, *map(str, (len(history.finds), history.fresh, history.refused)),
            f"{history.best:.4g}", str(len(history.violated)),
            str(history.violated[0].number) if history.violated else "–",
        )
        for history in histories
    ]  # fmt: skip
    return head, rows


def _table(archived: Sequence[tuple[Behaviour, Find]], files: dict[str, Path]) -> str:
    rows = [
        (
            behaviour.pair, f"{find.when:.3f}", behaviour.means, f"{find.robustness:.4g}",
            str(find.row.outcome), f"{find.row.worst_h:.4g}", fresh(find),
            f"found/{files[find.row.trajectory].name}" if find.row.trajectory in files else "–",
        )
        for behaviour, find in archived
    ]  # fmt: skip
    head = ("pair", "at [s]", "by", "robustness", "verdict", "worst h", "on fresh seeds", "file")
    return sortable(table(head, rows, most=_MOST)) if rows else note("None.")


def fresh(find: Find) -> str:
    """Return how often a find is violated on fresh seeds, with the 95 % interval."""
    if find.fresh_interval is None:
        return "–"
    low, high = find.fresh_interval
    return f"{find.fresh_violated} of {len(find.fresh)} [{low:.0%}, {high:.0%}]"


def _best(search: Search, find: Find, files: dict[str, Path]) -> str:
    """Return its verdict, its paths, and the fields in which it differs from the scenario."""
    evaluation = evaluate(load(table_of(search.space.table, find)))
    caption = (
        f"Paths seen from above, from the dots on to {find.when:.3f} s, and the distance of each "
        "adversary to the nearest normal agent over time. Adversaries are red."
    )
    t, x = evaluation.recording.times, evaluation.recording.x
    pictures = drawing(caption, partial(space_time_figure, search.swarm, t, x, find.when))
    file = files.get(find.row.trajectory)
    command = f" Repeat it: phalanx run {file}" if file else ""
    verdict = note(f"{evaluation.summary.outcome}: {evaluation.summary.reason}.{command}")
    changed = [(path, str(value)) for path, value in find.row.overrides.items()]
    return verdict + pictures + table(("field", "value of this attack"), changed)


def space_time_figure(swarm: Swarm, t: Array, x: Array, when: float) -> Figure:
    """Draw the distances of adversaries over time, and all paths up to a time [s]."""
    figure = Figure(figsize=(current().width, _HEIGHT), layout="constrained")
    above, over_time = figure.subplots(1, 2)
    for panel in (above, over_time):
        style_axes(panel)
    points = np.array([swarm.positions(state) for state in x[:: max(1, len(x) // 500)]])
    t = t[:: max(1, len(t) // 500)]
    until = t <= when
    for i, member in enumerate(swarm.members):
        colour = ADVERSARY if member.adversary else NORMAL
        above.plot(points[until, i, 0], points[until, i, 1], color=colour, linewidth=1.2)
        above.plot(*points[0, i, :2], "o", color=colour, markersize=4)
        above.annotate(
            member.name, points[0, i, :2], (5, 5), textcoords="offset points", color=colour
        )
        if member.adversary:
            distance = np.linalg.norm(points[:, list(swarm.normal)] - points[:, [i]], axis=2)
            over_time.plot(t, distance.min(axis=1), color=colour, linewidth=1.2, label=member.name)
    over_time.axvline(when, color=PEAK, linestyle="--", linewidth=1.0)
    over_time.set(xlabel="t [s]", ylabel="distance [m]")
    above.set(xlabel="x [m]", ylabel="y [m]")
    above.set_aspect("equal", adjustable="datalim")
    if any(member.adversary for member in swarm.members):
        over_time.legend(frameon=False)
    return figure
