"""The run of a failed test: its pair and time, how to repeat it, and its files."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from phalanx.launcher.engine import silent
from phalanx.launcher.run import Run
from phalanx.launcher.verify import commands_of
from phalanx.native.files import whole_file
from phalanx.scenario.load import read_table, scenario_text
from phalanx.schema.extensions import MissingExtensionError, extension
from phalanx_testing.conditions import table_of_scenario
from phalanx_testing.pytest.regressions import keep


def failure_lines(config: pytest.Config, test: str, run: Run, failed_claim: bool) -> Iterator[str]:
    """Yield a line for each thing to know, and keep the run as the options say.

    test: its node id, the name of a folder of artifacts.
    """
    scenario, summary, options = run.scenario, run.summary, config.option
    if summary is not None:
        yield f"verdict: {summary.outcome}: {summary.reason}"
        yield f"worst h: {summary.worst_in_words}"
    folder = run.folder
    if options.phalanx_artifacts is not None:
        copy = options.phalanx_artifacts / re.sub(r"[^\w.-]+", "-", test) / folder.name
        folder = Path(shutil.copytree(folder, copy, dirs_exist_ok=True))
    table = {**table_of_scenario(scenario), "seed": scenario.seed}
    if options.phalanx_shrink:
        table, words = _shrunk(run, table)
        yield f"shrunk: {words}"
    if commands_of(run.recording).schedule:
        yield "replay: the test itself, which gave commands on the way"
    else:
        with whole_file(folder / "scenario.toml") as part:
            part.write_text(scenario_text(table), encoding="utf-8")
        yield f"replay: phalanx run {folder / 'scenario.toml'}"
        if scenario.reading:
            yield f"or: {scenario.reading.command(scenario.seed)}"
    yield f"the same bits again: phalanx verify {folder}"
    yield f"report: {_report(folder, options.phalanx_artifacts is not None)}"
    folders = config.getini("phalanx_scenarios")
    if failed_claim and folders and options.phalanx_scenario is None:
        yield f"regression: {keep(folders[0], table, test)}"


def _report(folder: Path, written: bool) -> str:
    """Return the path of the report, which takes seconds to write, or the command that does."""
    try:
        return str(extension("report")(folder, silent)) if written else f"phalanx report {folder}"
    except MissingExtensionError as error:
        return str(error)


def _shrunk(run: Run, table: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """Return the smallest scenario that is violated as a run's, and how small it is, in words."""
    if run.summary is None or not run.summary.violations:
        return table, "no: only a violated run can be"
    try:
        smallest = extension("shrink")
    except MissingExtensionError as error:
        return table, f"no: {error}"
    reading = run.scenario.reading
    smaller_scenario = smallest(table, read_table(reading.source) if reading else table)
    before, after = smaller_scenario.sizes
    words = f"{after} values instead of {before}, after {smaller_scenario.runs} runs"
    return smaller_scenario.table, words
