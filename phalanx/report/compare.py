"""Several runs side by side: what differs in their scenarios, what they came to, their figures."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from phalanx.recording.read import Recording
from phalanx.report.html import comparison, key_figures
from phalanx.report.measures import link_statistics
from phalanx.report.write import image_of, plates

_SAME = ("name", "description", "reading")
"""Of a scenario, what has no effect."""
_ABSENT = "–"


def write_comparison(
    runs: Sequence[Recording], path: Path, progress: Callable[[str], None] | None = None
) -> Path:
    """Write one HTML page that shows the same figures of all runs side by side.

    Args:
        runs: two or more.
        path: of the page.
        progress: told what is drawn next.

    Returns:
        The path.

    Raises:
        OSError: it cannot be written.
    """
    names, drawn = titles(runs), dict[str, dict[str, bytes]]()
    for name, recording in zip(names, runs, strict=True):
        for plate in plates(recording, link_statistics(recording)):
            if progress:
                progress(f"{name}: {plate.name}")
            drawn.setdefault(plate.name, {})[name] = image_of(plate)
    page = comparison(names, differences(runs), results(runs), drawn)
    path.write_text(page, encoding="utf-8")
    return path


def titles(runs: Sequence[Recording]) -> list[str]:
    """A different title for each run: its folder's name, numbered where that is not enough."""
    folders = [run.path.resolve().parent.name for run in runs]
    return [
        f"{folder} ({number})" if folders.count(folder) > 1 else folder
        for number, folder in enumerate(folders, start=1)
    ]


def results(runs: Sequence[Recording]) -> list[tuple[str, ...]]:
    """Each key figure with its value in every run."""
    tables = [
        {"Verdict": str(run.summary.outcome) if run.summary else "unfinished"}
        | dict(key_figures(run))
        for run in runs
    ]
    rows = dict.fromkeys(name for table in tables for name in table)
    return [(name, *(table.get(name, _ABSENT) for table in tables)) for name in rows]


def differences(runs: Sequence[Recording]) -> list[tuple[str, ...]]:
    """Each setting in which the scenarios differ, with its value in every run."""
    tables = []
    for run in runs:
        table = json.loads(run.scenario.model_dump_json(by_alias=True))
        tables.append(dict(_leaves({k: v for k, v in table.items() if k not in _SAME})))
    paths = dict.fromkeys(path for table in tables for path in table)
    rows = [(path, *(table.get(path, _ABSENT) for table in tables)) for path in paths]
    return [row for row in rows if len(set(row[1:])) > 1]


def _rounded(value: Any) -> Any:
    """A number, or a list of them, with six digits."""
    if isinstance(value, list):
        return [_rounded(each) for each in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _leaves(value: Any, path: str = "") -> list[tuple[str, str]]:
    """Every number or text in a table, with its path as --set has it."""
    if isinstance(value, Mapping):
        steps = value.items()
    elif isinstance(value, list) and any(isinstance(each, Mapping) for each in value):
        steps = dict(enumerate(value)).items()
    else:
        return [(path, json.dumps(_rounded(value), ensure_ascii=False))]
    prefix = f"{path}." if path else ""
    return [leaf for key, each in steps for leaf in _leaves(each, f"{prefix}{key}")]
