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


def test_with_a_given_margin_only_certificates_promise_anything(check):
    found, table, words = check("one-on-one", "--strict")
    assert found == 0
    assert table["can end guaranteed"] == "yes"
    assert table["inputs with certificates at the start"] == "found for every agent"
    assert table["the paper's theorem"] == "proves nothing here"
    assert table["start"] == "inside the set that can be kept (S_I), largest ψ -1.89, allowed 0"
    assert table["margin η in force"] == "0.3"
    assert table["Theorem 4"].endswith("largest sum 0.3, allowed 0")
    given = "- The paper's theorem proves nothing here: the margin η is a given number"
    assert any(line.startswith(given) for line in words)


def test_without_certificates_at_the_start_strict_makes_a_failure(check):
    """At 5 m/s the other is there before the next sample."""
    chased = ["--set", "agents.1.start=[[0.0, -1.02]]", "--set", "agents.1.dynamics.speed=5.0"]
    relaxed, table, words = check("one-on-one", *chased)
    assert relaxed == 0
    assert check("one-on-one", *chased, "--strict")[0] == 1
    assert table["can end guaranteed"] == "no"
    assert table["inputs with certificates at the start"] == "none for 1"
    assert any(line.startswith("- No guarantee: at the start 1 has no input") for line in words)


def test_a_start_too_near_is_named_with_the_agent_that_has_no_solution(check):
    """h = 1 - 1.05² = -0.1025, and α(h) + η > 0."""
    _, table, words = check("one-on-one", "--set", "agents.1.start=[[0.0, -1.05]]")
    assert table["start"] == "inside the set that can be kept (S_I), largest ψ -0.1025, allowed 0"
    assert table["inputs that keep the rows at the start (K_i)"] == "empty for 1"
    assert any(
        line.startswith("- At the start no input satisfies the rows of 1 ") for line in words
    )


def test_nothing_keeps_the_guaranteed_scenario_from_its_guarantee(check):
    found, table, words = check("guaranteed", "--strict")
    assert found == 0
    assert table["can end guaranteed"] == "yes"
    assert table["margin η in force"] == "none given: computed at each sample"
    assert table["the paper's theorem"] == "may apply: the run checks"
    assert not [line for line in words if "No guarantee" in line]


def test_the_picture_is_saved_where_it_was_asked_for(check, tmp_path):
    picture = tmp_path / "backup.png"
    assert check("one-on-one", "--plot", str(picture))[0] == 0
    pixels = matplotlib.image.imread(picture)[:, :, :3]
    suffices = np.isclose(pixels, to_rgb("#bfe3c6"), atol=0.01).all(axis=2)
    assert suffices.mean() > 0.2
