"""The tables of a run: what docs/reference/api.md says, the same h, and fit to be put together."""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import phalanx
from phalanx.recording.read import read
from phalanx.recording.records import Log
from phalanx.recording.tables import h_table
from phalanx.scenario.model import Scenario
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from tests.unit.report.recordings import drift, record, summary_of, unicycles

PAGE = (Path(__file__).parents[3] / "docs" / "reference" / "api.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `run\.(\w+)` \|[^|]*\| (.*) \|$", re.MULTILINE)
EVERY = ["run", "scenario", "seed"]
TABLES = ("states", "h", "inputs", "links", "events")


@pytest.fixture
def run(tmp_path: Path) -> phalanx.Run:
    return recorded(tmp_path, unicycles())


def recorded(folder: Path, scenario: Scenario) -> phalanx.Run:
    """A run of which every table has a row."""
    records = [*drift(scenario), Log(0.1, "agent 4 killed")]
    return phalanx.open(record(folder, scenario, records, summary_of(scenario)))


def in_general(column: str) -> str:
    """A column's name as the page has it."""
    found = re.sub(r"^(u|nominal)\..*", r"\1.name", column)
    return re.sub(r"^\d+\.\w+$", "agent.state", re.sub(r"^\d+-.*", "agent-agent", found))


def test_the_page_names_every_column_in_order(run: phalanx.Run) -> None:
    documented = {name: re.findall(r"`([^`]+)`", cells) for name, cells in ROW.findall(PAGE)}
    columns = {name: getattr(run, name).columns for name in (*TABLES, "metrics")}
    assert documented.keys() == columns.keys()
    for name, headings in columns.items():
        assert headings[: len(EVERY)] == EVERY
        assert documented[name] == list(dict.fromkeys(map(in_general, headings[len(EVERY) :])))


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_tables_of_runs_can_be_put_together_and_separated(name: str, tmp_path: Path) -> None:
    tables = []
    for seed in (3, 4):
        (folder := tmp_path / str(seed)).mkdir()
        run = recorded(folder, unicycles().model_copy(update={"seed": seed}))
        tables.append(getattr(run, name))
    both = pl.concat(tables)
    assert len(both) == sum(map(len, tables))
    assert set(both.select("scenario", "seed").rows()) == {("unicycles", 3), ("unicycles", 4)}


def test_a_run_that_ended_before_a_state_has_tables_without_a_row(tmp_path: Path) -> None:
    scenario = unicycles()
    run = phalanx.open(record(tmp_path, scenario, [], summary_of(scenario)))
    assert [getattr(run, name).height for name in TABLES] == [0] * 5
    assert run.h.columns[:5] == [*EVERY, "t", "1-2"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unicycles", "surrounded", "fence", "formation3d"])
def test_h_by_kinds_of_pairs_is_that_of_the_composed_set(name: str, tmp_path: Path) -> None:
    scenario = phalanx.load(name, ["duration=0.2"])
    records = drift(scenario, states=40, steps=0)
    recording = read(record(tmp_path, scenario, records, summary_of(scenario)))
    swarm = build_swarm(scenario)
    composed = swarm.safe_set
    h = CompiledFunction([composed.x], [composed.h])
    table = h_table(recording, swarm).drop("run", "scenario", "seed", "t")
    assert np.array_equal(table.to_numpy(), [h(x)[0] for x in recording.x])
