"""Write the page of a study, from its data frame: one row for each run."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import polars as pl

from phalanx.guarantee.verdict import Outcome
from phalanx.report.html import drawing, note, save_page, section, sortable, table
from phalanx.schema.notebook import html_table
from phalanx_studies.page.figures import distribution_figure, heat_figure, rates_figure
from phalanx_studies.page.groups import Group, by_axis, group, in_percent, labels, outcomes_of
from phalanx_studies.row import REFUSED, counted, without_effect
from phalanx_studies.statistics import Rate

MOST_LISTED = 500
_MOST_MAPS = 3
"""Most pairs of axes that have heat maps."""
_MOST_CURVES = 4
"""Most distributions in one figure."""
_LONGEST = 300
"""Most letters of a cell."""
_COLUMNS = (
    "seed", "outcome", "worst_h", "worst_at", "worst_pair", "certified", "shortest", "empty",
    "faults", "input_deviation_mean", "tracking_error_mean", "searched", "reason",
)  # fmt: skip
_INTERVALS = (
    "In brackets: 95 % intervals, each by itself. They are Clopper and Pearson's; where runs share "
    "seeds, each seed counts once, a seed that lacks runs does not, and the interval is that of "
    "betting."
)
_WORST_FIRST = (
    Outcome.VIOLATED, Outcome.BROKEN, Outcome.STOPPED, Outcome.SAFE, Outcome.GUARANTEED, REFUSED,
)  # fmt: skip


def write_study_page(
    frame: pl.DataFrame,
    axes: Sequence[str],
    title: str,
    path: Path,
    command: Callable[[dict[str, Any]], str],
) -> Path:
    """Write one HTML file that needs no other, of a row for each run; return its path.

    axes: names of the columns that were varied. command: gives the command that repeats a row.
    Raises OSError; ValueError if the frame lacks an axis.
    """
    if lacking := [axis for axis in axes if axis not in frame.columns]:
        raise ValueError(f"axes: expected columns of the frame, got {lacking[0]!r}")
    runs = counted(frame)
    groups = {axis: by_axis(runs, axis) for axis in axes}
    parts = [
        *map(note, without_effect(runs, axes)),
        section("Outcomes", _rates("", [group("all", runs)]) + note(_INTERVALS)),
        *(section(f"Over {axis}", _over(axis, parts)) for axis, parts in groups.items()),
        *_maps(runs, axes),
        *_distribution(runs, groups),
        section("Rows, the worst first", _rows(frame, axes, command)),
    ]
    return save_page(path, title, parts, about=_counts(frame, runs))


def study_rates(frame: pl.DataFrame, axes: Sequence[str]) -> str:
    """Return the rates over each axis as HTML tables, for a notebook."""
    runs = counted(frame)
    tables = {"": [group("all", runs)]}
    tables |= {axis: by_axis(runs, axis) for axis in axes}
    return "".join(html_table(*_rate_rows(axis, parts)) for axis, parts in tables.items())


def _counts(frame: pl.DataFrame, runs: pl.DataFrame) -> str:
    """Say how many rows there are, and how many of them enter no interval."""
    refused = frame.filter(pl.col("outcome") == REFUSED).height
    searched = frame.filter(pl.col("searched") & (pl.col("outcome") != REFUSED)).height
    parts = [f"{frame.height} rows", f"{runs.height} runs with {runs['seed'].n_unique()} seeds"]
    if refused:
        parts.append(f"{refused} refused, since their scenario is not valid")
    if searched:
        parts.append(f"{searched} chosen by a search, which are listed and enter no interval")
    return "; ".join(parts)


def _rate_rows(axis: str, groups: Sequence[Group]) -> tuple[list[tuple[str, ...]], tuple[str, ...]]:
    """Return the rows of a table of rates, and its head."""
    outcomes = outcomes_of(groups)
    rows = [
        (part.label, _runs(part), *(_in_words(part.rates[name]) for name in outcomes))
        for part in groups
    ]
    return rows, (axis, "runs", *outcomes)


def _rates(axis: str, groups: Sequence[Group]) -> str:
    rows, head = _rate_rows(axis, groups)
    return table(head, rows)


def _runs(part: Group) -> str:
    """Return the number of a group's runs that its rates count."""
    count, all_of_it = part.rates[Outcome.VIOLATED].runs, len(part.rows)
    return str(count) if count == all_of_it else f"{count} of {all_of_it}"


def _in_words(rate: Rate) -> str:
    share, (low, high), runs = rate
    if not runs:
        return "–"
    return f"{in_percent(share)} % [{in_percent(low)}, {in_percent(high)}]"


def _over(axis: str, groups: Sequence[Group]) -> str:
    if not groups:
        return note("No runs.")
    caption = f"Rate of each outcome over {axis}, with 95 % intervals; other axes are averaged."
    curves = drawing(caption, partial(rates_figure, axis, groups, outcomes_of(groups)))
    return curves + _rates(axis, groups)


def _maps(runs: pl.DataFrame, axes: Sequence[str]) -> Iterator[str]:
    """Make heat maps of the first pairs of axes."""
    pairs = list(itertools.combinations(axes, 2)) if len(runs) else []
    for pair in pairs[:_MOST_MAPS]:
        (columns, of_column), (rows, of_row) = (labels(runs[axis]) for axis in pair)
        marked = runs.with_columns(column_=of_column, row_=of_row)
        cells = {
            (i, j): group("", cell)
            for (i, j), cell in marked.group_by("column_", "row_", maintain_order=True)
        }
        parts = [
            drawing(
                f"Rate of {outcome} runs over {pair[0]} and {pair[1]}, with its 95 % interval.",
                partial(heat_figure, pair, (columns, rows), cells, outcome),
            )
            for outcome in (Outcome.VIOLATED, Outcome.GUARANTEED)
        ]
        yield section(f"{pair[0]} and {pair[1]}", "".join(parts))
    if len(pairs) > _MOST_MAPS:
        yield note(f"{len(pairs) - _MOST_MAPS} more pairs of axes are not drawn.")


def _distribution(runs: pl.DataFrame, groups: Mapping[str, Sequence[Group]]) -> Iterator[str]:
    """Make the figure of the distribution of worst h, at each value of the first axis if few."""
    if runs["worst_h"].is_not_null().any():
        axis, of_axis = next(iter(groups.items()), ("", ()))
        few = 1 < len(of_axis) <= _MOST_CURVES
        curves = of_axis if few else [Group("all", runs, {})]
        caption = (
            f"Distribution of the worst h{f', by {axis}' if few else ''}, with the 95 % band of "
            "Dvoretzky, Kiefer and Wolfowitz. Where runs share seeds, it is of one run of each "
            "seed, drawn at random."
        )
        if absent := runs["worst_h"].null_count():
            caption += f" {absent} runs without h are left out."
        yield section("Worst h", drawing(caption, partial(distribution_figure, curves)))


def _rows(
    frame: pl.DataFrame, axes: Sequence[str], command: Callable[[dict[str, Any]], str]
) -> str:
    """Make the table of the worst rows: the gravest outcome first, then the largest worst h."""
    rank = pl.col("outcome").replace_strict(
        {outcome: i for i, outcome in enumerate(map(str, _WORST_FIRST))}, default=0
    )
    ordered = frame.with_columns(rank_=rank).sort(
        "rank_", "worst_h", "index", descending=[False, True, False], nulls_last=True
    )
    columns = list(dict.fromkeys([*axes, *_COLUMNS]))  # `faults` may be an axis
    rows = [
        (str(row["index"]), *(_cell(row[name]) for name in columns), command(row))
        for row in ordered.head(MOST_LISTED).drop("rank_").iter_rows(named=True)
    ]
    element = table(("index", *columns, "command"), rows, len(frame), MOST_LISTED)
    return sortable(element) if rows else element


def _cell(value: Any) -> str:
    if value is None or value == "":
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"
