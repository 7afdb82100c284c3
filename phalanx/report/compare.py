"""Several runs side by side: differences of their scenarios, their results, their figures."""

import json
import multiprocessing
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from phalanx.recording.curves.history import ReportHistory
from phalanx.recording.curves.series import Series
from phalanx.recording.metrics.table import metrics_of, swarm_rows
from phalanx.recording.read import read, swarm_of
from phalanx.report.html import figure, note, save_page, section, table
from phalanx.report.links import link_statistics
from phalanx.report.style import LIMIT, NORMAL, WORST, draw_line, image_of, legend, over_time
from phalanx.report.write import draw_figures, key_figures

_SAME = ("name", "description", "reading")
"""Fields of a scenario without effect on the run."""
_ABSENT = "–"
_TOGETHER = "h_tot of all runs; below, their differences from the first run at the same times."


@dataclass(frozen=True)
class ComparedRun:
    """Settings, results and figures of one run."""

    folder: str
    """Its name."""
    settings: dict[str, str]
    """Every number or text of the scenario by its path, and the SHA-256 of the user's modules."""
    results: dict[str, str]
    """Key figures and the swarm's metrics by name."""
    figures: dict[str, bytes]
    """PNG by name; none unless they were asked for."""
    h_tot: Series
    """At every recorded state."""


def compared_run(run: Path, *, draw: bool, trust: bool = False) -> ComparedRun:
    """Read one run, and draw its figures if they are asked for.

    Two recordings may have different modules under the same name. Trusted code of each recording
    is therefore run in a process of its own.

    Raises UnreadableRecordingError as read does.
    """
    if not trust:
        return _compared(run, draw)
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=spawn) as executor:
        return executor.submit(_compared, run, draw, trust=True).result()


def _compared(folder: Path, draw: bool, trust: bool = False) -> ComparedRun:
    run = read(folder, trust)
    scenario = json.loads(run.scenario.model_dump_json(by_alias=True))
    settings = dict(_leaves({k: v for k, v in scenario.items() if k not in _SAME}))
    verdict = str(run.summary.outcome) if run.summary else f"unfinished: {run.unfinished}"
    figures = draw_figures(ReportHistory(run), link_statistics(run)) if draw else ()
    metrics = swarm_rows(metrics_of(run, swarm_of(run)))
    return ComparedRun(
        run.path.resolve().parent.name,
        settings | {path: digest[:12] for path, digest in run.modules.items()},
        {"Verdict": verdict, **dict(key_figures(run)), **dict(metrics)},
        {drawing.name: image_of(drawing.figure) for drawing in figures},
        Series(run.times, run.h_tot),
    )


def write_comparison(runs: Sequence[ComparedRun], path: Path) -> Path:
    """Write one HTML page that shows the same figures of two or more runs side by side.

    Returns the path. Raises OSError if it cannot be written.
    """
    names = titles(runs)
    title, head = f"{len(runs)} runs", ("", *names)
    parts = [
        section("Differences", table(head, differences(runs))),
        section("Results", table(head, results(runs))),
    ]
    if all(len(run.h_tot.t) for run in runs):
        both = overlay({name: run.h_tot for name, run in zip(names, runs, strict=True)})
        parts.append(section("h_tot of all", figure(_TOGETHER, image_of(both))))
    for figure_name in dict.fromkeys(name for run in runs for name in run.figures):
        pictures = "".join(
            figure(name, run.figures[figure_name])
            if figure_name in run.figures
            else note(f"{name}: nothing to draw")
            for name, run in zip(names, runs, strict=True)
        )
        parts.append(section(figure_name, f'<div class="side-by-side">{pictures}</div>'))
    return save_page(path, title, parts, width="none")


def titles(runs: Sequence[ComparedRun]) -> list[str]:
    """A different title for each run: its folder's name, numbered where that is not enough."""
    folders = [run.folder for run in runs]
    return [
        f"{folder} ({number})" if folders.count(folder) > 1 else folder
        for number, folder in enumerate(folders, start=1)
    ]


def results(runs: Sequence[ComparedRun]) -> list[tuple[str, ...]]:
    """Each key figure with its value in every run."""
    return _side_by_side([run.results for run in runs])


def differences(runs: Sequence[ComparedRun]) -> list[tuple[str, ...]]:
    """Each setting in which the scenarios differ, with its value in every run."""
    rows = _side_by_side([run.settings for run in runs])
    return [row for row in rows if len(set(row[1:])) > 1]


def _side_by_side(tables: Sequence[Mapping[str, str]]) -> list[tuple[str, ...]]:
    names = dict.fromkeys(name for table in tables for name in table)
    return [(name, *(table.get(name, _ABSENT) for table in tables)) for name in names]


def _rounded(value: Any) -> Any:
    """A number, or a list of them, with six digits."""
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _leaves(value: Any, path: str = "") -> list[tuple[str, str]]:
    """Every number or text in a table, with its path as in --set."""
    if isinstance(value, Mapping):
        steps = value.items()
    elif isinstance(value, list) and any(isinstance(item, Mapping) for item in value):
        steps = dict(enumerate(value)).items()
    else:
        return [(path, json.dumps(_rounded(value), ensure_ascii=False))]
    prefix = f"{path}." if path else ""
    return [leaf for key, item in steps for leaf in _leaves(item, f"{prefix}{key}")]


def overlay(h_tot: Mapping[str, Series]) -> Figure:
    """Draw h_tot of runs, by their titles, over one another; below, less that of the first run.

    A difference is taken at the run's own times up to the first run's end, where h_tot of the
    first is interpolated between its states.
    """
    figure, (above, below) = over_time(2, 2.6)
    (_, base), *_ = h_tot.items()
    for (title, series), colour in zip(h_tot.items(), cycle((NORMAL, *WORST))):
        label = f"{title}: largest {np.nanmax(series.y):.4g}"
        draw_line(above, series, colour=colour, width=1.2, label=label)
        if series is not base:
            common = Series(*(values[series.t <= base.t[-1]] for values in series))
            difference = Series(common.t, common.y - np.interp(common.t, *base))
            label = f"{title}: at most {np.abs(difference.y).max(initial=0.0):.3g}"
            draw_line(below, difference, colour=colour, width=1.0, label=label)
    for axes, name in ((above, "$h_{tot}$"), (below, "$h_{tot}$, less the first's")):
        axes.axhline(0.0, color=LIMIT, linewidth=1.2)
        axes.set_ylabel(name)
        legend(axes)
    return figure
