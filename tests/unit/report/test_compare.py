"""Runs side by side: their differences, their results, and the same figures."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from phalanx.cli.app import USAGE_ERROR, status
from phalanx.recording.curves.series import Series
from phalanx.report.compare import compared_run, differences, overlay, results, titles
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two runs whose loss differs, and nothing else; the first ended before a step."""
    out, recorded = tmp_path_factory.mktemp("runs"), []
    for loss, steps in ((0.0, 0), (0.3, 40)):
        folder = out / f"loss-{loss}"
        folder.mkdir()
        scenario = swarm_in_space(2, 1, {"network": {"loss": loss}})
        recorded.append(
            record(folder, scenario, drift(scenario, steps=steps), summary_of(scenario))
        )
    return recorded


def test_differences_of_scenarios_are_listed_and_key_figures_of_each_run(folders: list[Path]):
    runs = one, _ = [compared_run(folder, draw=False) for folder in folders]
    assert differences(runs) == [("network.loss", "0.0", "0.3")]
    rows = {name: values for name, *values in results(runs)}
    assert rows["Verdict"] == ["violated", "violated"]
    assert rows["Worst h"] == ["0.25 at t = 0.300 s"] * 2
    assert "Empty K_i" in rows
    assert titles(runs) == ["loss-0.0", "loss-0.3"]
    assert titles([one, one]) == ["loss-0.0 (1)", "loss-0.0 (2)"]


@pytest.mark.nightly
def test_the_page_has_the_same_figures_of_all_runs(folders: list[Path], tmp_path: Path) -> None:
    page = tmp_path / "compared.html"
    assert status(["compare", *map(str, folders), "--html", str(page)]) == 0
    html = page.read_text()
    for name in ("h_tot of all", "h_tot", "paths", "distances", "losses"):
        section = html.split(f"<h2>{name}</h2>")[1].split("<h2>")[0]
        count = 1 if name in ("h_tot of all", "losses") else 2
        assert len(re.findall("<img", section)) == count
    assert "loss-0.0: nothing to draw" in html.split("<h2>losses</h2>")[1]


def test_runs_lie_over_one_another_and_their_differences_below() -> None:
    t = np.linspace(0.0, 1.0, 11)
    longer = np.linspace(0.0, 2.0, 5)
    above, below = overlay({"a": Series(t, t - 2.0), "b": Series(longer, longer - 1.5)}).axes
    assert [line.get_label() for line in above.lines[:2]] == ["a: largest -1", "b: largest 0.5"]
    (line,) = below.lines[:1]
    assert line.get_label() == "b: at most 0.5"
    assert line.get_xydata().tolist() == [[0.0, 0.5], [0.5, 0.5], [1.0, 0.5]]


def test_one_run_is_not_compared(folders: list[Path], capsys: pytest.CaptureFixture[str]) -> None:
    assert status(["compare", str(folders[0])]) == USAGE_ERROR
    assert "two runs or more" in capsys.readouterr().err


RECORD = """
from pathlib import Path
from phalanx.recording.records import RECORDING
from phalanx.recording.write import RecordingWriter
from phalanx.scenario.load import load
scenario = load("one-on-one", {"agents.0.law.type": "law_of_two_versions:Mine"})
with RecordingWriter(Path(RECORDING), scenario, "r") as writer:
    writer._writer.finish()
"""


@pytest.fixture(scope="module")
def versions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two runs with other modules of the user's under the same name."""
    out, recorded = tmp_path_factory.mktemp("versions"), []
    for gain in (1, 2):
        folder = out / f"gain-{gain}"
        folder.mkdir()
        module = folder / "law_of_two_versions.py"
        module.write_text(f"from phalanx.extend import TrackVelocity as Mine  # {gain}")
        subprocess.run([sys.executable, "-c", RECORD], cwd=folder, check=True)
        module.unlink()
        recorded.append(folder)
    return recorded


@pytest.mark.nightly
@pytest.mark.slow
def test_runs_with_modules_of_one_name_are_compared_each_in_a_process_of_its_own(
    versions: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status(["compare", "--trust", *map(str, versions)]) == 0
    table = capsys.readouterr().out
    (row,) = [line for line in table.splitlines() if line.startswith("law_of_two_versions.py")]
    _, one, two = row.split()
    assert one != two
    assert "law_of_two_versions" not in sys.modules


@pytest.mark.slow
def test_runs_with_modules_that_are_not_trusted_are_refused_with_what_to_do(
    versions: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status(["compare", *map(str, versions)]) == 3
    assert "--trust" in capsys.readouterr().err
