"""A run's line in a summary and in `phalanx runs`; commands say if a recording was cut short."""

import os
import re
from pathlib import Path

import msgspec
import pytest
from phalanx_viewer.feeds.replay import Replay
from phalanx_viewer.page.panels import verdict_text

import phalanx
from phalanx.cli import run as command
from phalanx.cli.app import status
from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.live import announced
from phalanx.launcher.run import run
from phalanx.messages.membership import Membership
from phalanx.recording.read import read
from phalanx.recording.records import RECORDING
from phalanx.scenario.load import load
from tests.unit.report.recordings import drift, record, summary_of, swarm_in_space


def test_each_run_has_a_line_that_says_how_it_ended(tmp_path, capsys):
    scenario = swarm_in_space(2, 1, {})
    folders = [tmp_path / name for name in ("new [red]-2", "old-1", "cut-3", "live-4")]
    for age, folder in enumerate(folders):
        folder.mkdir()
        record(folder, scenario, drift(scenario, steps=0), summary_of(scenario))
        os.utime(folder / "recording.mcap", (1e9 - age, 1e9 - age))
    ended = msgspec.json.encode(summary_of(scenario))
    for folder in folders[:2]:
        (folder / "summary.json").write_bytes(ended)
    (folders[2] / "summary.json").write_bytes(ended[:20])
    with announced(folders[3], Membership("r", "tcp/127.0.0.1:7447", secret=b"s" * 16)):
        assert status(["runs", str(tmp_path)]) == 0
    head, live, cut, old, new = capsys.readouterr().out.splitlines()
    assert head.split() == ["run", "verdict", "time", "seed", "worst", "h", "certified"]
    assert "live-4" in live
    assert "running" in live
    assert "broken: no summary" in cut
    assert "old-1" in old
    assert "new [red]-2" in new
    assert "violated" in new
    assert "0.25" in new


def test_a_folder_without_runs_says_how_to_make_one(tmp_path, capsys):
    assert status(["runs", str(tmp_path / "none")]) == 3
    assert "no runs in this folder; make one with: phalanx run" in capsys.readouterr().err


@pytest.mark.slow
def test_what_was_cut_short_is_compared_up_to_its_end_and_the_reason_is_said(tmp_path, capsys):
    whole = run(load("one-on-one", {"duration": 0.05}), engine="in-process")
    stopped = summary_of(whole.scenario, "by Ctrl-C")
    stopped = msgspec.structs.replace(stopped, outcome=Outcome.STOPPED)
    records = [*whole.recording.states[:3], *whole.recording.steps[:4]]
    record(tmp_path, whole.scenario, records, stopped)
    assert status(["verify", str(tmp_path), "--engine", "in-process"]) == 0
    why, result = capsys.readouterr().out.splitlines()
    assert why.endswith("by Ctrl-C; comparing up to its end")
    assert result == "bit-identical: 4 steps and 3 states"
    whole.recording.steps[1].residual += 1.0
    (tmp_path / "other").mkdir()
    record(tmp_path / "other", whole.scenario, records, stopped)
    assert status(["verify", str(tmp_path / "other"), "--engine", "in-process"]) == 1
    assert "residual" in capsys.readouterr().out


def printed(scenario: str, out: Path, capsys: pytest.CaptureFixture[str], *sets: str) -> str:
    """Run a scenario for a moment; return the summary with single spaces."""
    command = ["run", scenario, "--engine", "in-process", "--no-report", "--out", str(out)]
    chosen = [part for each in ("duration=0.2", *sets) for part in ("--set", each)]
    assert status([*command, *chosen]) == 0
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_the_summary_says_how_far_the_agents_came(tmp_path, capsys):
    shown = printed("crossing", tmp_path, capsys)
    assert "task 0 of 4 arrived, tracking error" in shown
    assert "m on average, least distance" in shown
    assert "broadcasts 20 a second and agent, of at most" in shown


@pytest.mark.slow
def test_agents_without_goals_have_no_task(tmp_path, capsys):
    goals = "agents.0.law={type='chase', gains=[1.0]}"
    assert "task" not in printed("crossing", tmp_path, capsys, goals, "agents.0.goal=[]")


@pytest.mark.slow
def test_a_large_recording_is_not_read_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "_LARGE", 1)
    assert "task a large recording: see" in printed("crossing", tmp_path, capsys)


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


@pytest.mark.slow
def test_the_api_says_so(folders):
    found = phalanx.open(folders[1])
    assert found.verdict is None
    assert CUT_SHORT.search(repr(found))
    assert CUT_SHORT.search(found._repr_html_())


@pytest.mark.slow
def test_a_replay_says_so_at_its_beginning_already(folders):
    replay = Replay(read(folders[1]))
    said = verdict_text(replay.frame(0.0), replay.summary, replay.unfinished)
    assert CUT_SHORT.search(said)
    assert "guaranteed" not in said
