"""The page of a search: its curve next to that of random search, and its archive."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from phalanx.report.html import drawing, note, save_page, section, sortable, table
from phalanx.report.style import NORMAL, PEAK, legend, panels
from phalanx_attacks.archive import Behaviour, Find
from phalanx_attacks.search import History, Search

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
            parts.append(section("The best attack", _best(archived[0][1], files)))
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


def _best(find: Find, files: dict[str, Path]) -> str:
    """Return its verdict, how to repeat it, and the fields in which it differs."""
    file = files.get(find.row.trajectory)
    command = f" Repeat it: phalanx run {file}" if file else ""
    verdict = note(f"{find.row.outcome}: {find.row.reason}.{command}")
    changed = [(path, str(value)) for path, value in find.row.overrides.items()]
    return verdict + table(("field", "value of this attack"), changed)
