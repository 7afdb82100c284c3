"""A recording in a folder of another's making: its links lead no report out of it."""

from pathlib import Path

import pytest

import phalanx
from phalanx.cli.app import FAILED, status
from phalanx.recording.records import RECORDING
from phalanx.recording.write import RecordingWriter
from phalanx.report.write import REPORT
from phalanx.scenario.load import load
from tests.unit.report.recordings import drift, record, summary_of

pytestmark = pytest.mark.slow


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A folder with a recording of two states, next to a folder with a file."""
    scenario = load("one-on-one", ["duration=0.1"])
    for name in ("run", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / "elsewhere" / "file").write_text("precious")
    records = drift(scenario, states=2, steps=0)
    return record(tmp_path / "run", scenario, records, summary_of(scenario))


def test_a_link_in_the_place_of_a_report_or_a_figure_is_replaced(run: Path):
    target = run.parent / "elsewhere" / "file"
    (run / "figures").mkdir()
    links = run / REPORT, run / "figures" / "h_tot.png"
    for link in links:
        link.symlink_to(target)
    assert phalanx.open(run).report() == run / REPORT
    assert target.read_text() == "precious"
    assert not any(link.is_symlink() for link in links)
    assert "</html>" in (run / REPORT).read_text()


def test_a_link_in_the_place_of_the_folder_of_figures_is_refused(run: Path, capsys):
    (run / "figures").symlink_to(run.parent / "elsewhere")
    assert status(["report", str(run)]) == FAILED
    assert f"{run / 'figures'}: expected a folder, found a link" in capsys.readouterr().err
    assert [file.name for file in (run.parent / "elsewhere").iterdir()] == ["file"]
    assert [file.name for file in run.iterdir() if not file.is_symlink()] == [RECORDING]


def test_a_recording_in_no_order_of_time_is_reported_up_to_there(tmp_path: Path, capsys):
    whole = phalanx.run(load("unicycles", ["duration=0.1"]), engine="in-process").recording
    with RecordingWriter(tmp_path / RECORDING, whole.scenario, "run-1") as writer:
        writer.write(*whole.states[::-1], *whole.steps)
        writer.finish(whole.summary)
    assert status(["report", str(tmp_path)]) == 0
    line, *_ = capsys.readouterr().err.splitlines()
    assert "damaged after t = 0.100 s: a record of t = 0.09" in line
