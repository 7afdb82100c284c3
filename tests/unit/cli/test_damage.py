"""Every command reports that a recording was cut short, and shows no verdict of it."""

import re
from pathlib import Path

import pytest
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import verdict_text

import phalanx
from phalanx.cli.app import status
from phalanx.recording.read import read
from phalanx.recording.records import RECORDING

CUT_SHORT = re.compile(r"cut\s+short\s+after\s+t\s+=\s+0\.\d{3}\s+s")


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A run that was guaranteed, whole, and without its last byte, which is behind the verdict."""
    out = tmp_path_factory.mktemp("runs")
    runs = [
        phalanx.run(phalanx.load("guaranteed", ["duration=0.1"]), engine="in-process", out=out)
        for _ in range(2)
    ]
    assert runs[1].verdict == "guaranteed"
    file = runs[1].folder / RECORDING
    file.write_bytes(file.read_bytes()[:-1])
    return [run.folder for run in runs]


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        pytest.param(["report"], marks=pytest.mark.nightly),
        ["certify"],
        ["export", "--html", "{file}"],
        ["export", "--mcap", "{file}"],
        ["export", "--csv", "{file}"],
    ],
    ids=" ".join,
)
def test_a_command_says_so(command, folders, tmp_path, capfd):
    whole, cut = folders
    assert "guaranteed" in (whole / "summary.json").read_text()
    name, *options = (part.format(whole=whole, file=tmp_path / "made") for part in command)
    status([name, *options, str(cut)])
    text = "".join(capfd.readouterr())
    output = cut / "report.html" if name == "report" else tmp_path / "made"
    text += output.read_text(errors="replace") if output.is_file() else ""
    assert CUT_SHORT.search(text)
    assert text.lower().count("guaranteed:") == 0


def test_the_api_says_so(folders):
    found = phalanx.open(folders[1])
    assert found.verdict is None
    assert CUT_SHORT.search(repr(found))
    assert CUT_SHORT.search(found._repr_html_())


def test_a_replay_says_so_at_its_beginning_already(folders):
    replay = Replay(read(folders[1]))
    said = verdict_text(replay.frame(0.0), replay.summary, replay.unfinished)
    assert CUT_SHORT.search(said)
    assert "guaranteed" not in said
