"""phalanx check: its exit status, its table and its picture say what the check found."""

import re

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from phalanx.cli.app import status


@pytest.fixture
def check(capsys, monkeypatch):
    """Run the command; its exit status, its table by first column, and the lines after it."""
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str) -> tuple[int, dict[str, str], list[str]]:
        found = status(["check", *arguments])
        lines = capsys.readouterr().out.splitlines()
        words = [line for line in lines if line.startswith("- ") and line.endswith(".")]
        rows = (re.split(r"\s{2,}", line.strip(), maxsplit=1) for line in lines)
        return found, dict(row for row in rows if len(row) == 2), words

    return run


def test_a_given_margin_keeps_one_on_one_from_a_guarantee_which_strict_makes_a_failure(check):
    relaxed, table, words = check("one-on-one")
    assert relaxed == 0
    assert check("one-on-one", "--strict")[0] == 1
    assert table["can end guaranteed"] == "no"
    assert table["start"] == "inside the set that can be kept (S_I), largest ψ -1.89"
    assert table["margin η in force"] == "0.3"
    assert table["Theorem 4"].endswith("largest sum 0.3")
    assert any(line.startswith("- No guarantee: the margin η is a given number") for line in words)


def test_a_start_too_near_is_named_with_the_agent_that_has_no_solution(check):
    """h = 1 - 1.05² = -0.1025, and α(h) + η > 0."""
    _, table, words = check("one-on-one", "--set", "agents.1.start=[[0.0, -1.05]]")
    assert table["start"] == "inside the set that can be kept (S_I), largest ψ -0.1025"
    assert table["inputs that keep the rows at the start (K_i)"] == "empty for 1"
    assert any(
        line.startswith("- At the start no input satisfies the rows of 1 ") for line in words
    )


def test_nothing_keeps_the_guaranteed_scenario_from_its_guarantee(check):
    found, table, words = check("guaranteed", "--strict")
    assert found == 0
    assert table["can end guaranteed"] == "yes"
    assert table["margin η in force"] == "none given: local"
    assert not [line for line in words if "No guarantee" in line]


def test_the_picture_is_saved_where_it_was_asked_for(check, tmp_path):
    picture = tmp_path / "backup.png"
    assert check("one-on-one", "--plot", str(picture))[0] == 0
    pixels = matplotlib.image.imread(picture)[:, :, :3]
    suffices = np.isclose(pixels, to_rgb("#bfe3c6"), atol=0.01).all(axis=2)
    assert suffices.mean() > 0.2
