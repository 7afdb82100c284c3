"""The line of a run's summary about its task."""

from pathlib import Path

import pytest

from phalanx.cli import run as command
from phalanx.cli.app import status


def printed(scenario: str, out: Path, capsys: pytest.CaptureFixture[str], *sets: str) -> str:
    """Run a scenario for a moment; return the summary with single spaces."""
    asked = ["run", scenario, "--engine", "in-process", "--no-report", "--out", str(out)]
    chosen = [part for each in ("duration=0.2", *sets) for part in ("--set", each)]
    assert status([*asked, *chosen]) == 0
    return " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
def test_the_summary_says_how_far_the_agents_came(tmp_path, capsys):
    shown = printed("crossing", tmp_path, capsys)
    assert "task 0 of 4 arrived, tracking error" in shown
    assert "m on average, least distance" in shown


@pytest.mark.slow
def test_agents_without_goals_have_no_task(tmp_path, capsys):
    goals = "agents.0.law={type='chase', gains=[1.0]}"
    assert "task" not in printed("crossing", tmp_path, capsys, goals, "agents.0.goal=[]")


@pytest.mark.slow
def test_a_large_recording_is_not_read_again(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(command, "_LARGE", 1)
    assert "task a large recording: see" in printed("crossing", tmp_path, capsys)
