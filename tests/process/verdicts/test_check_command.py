"""phalanx check: its exit status, its table and its picture say what the check found."""

import re

import pytest

from phalanx.cli.app import status
from tests.unit.swarms import checked


@pytest.fixture
def check(capsys, monkeypatch):
    """Run the command at 80 columns; its exit status, its heading, its table and its words."""
    monkeypatch.setenv("COLUMNS", "80")

    def run(*arguments: str) -> tuple[int, str, dict[str, list[str]], str]:
        exit_status = status(["check", *arguments])
        lines = capsys.readouterr().out.splitlines()
        assert all(len(line) <= 80 or line.startswith("picture: ") for line in lines)
        heading, _, *rest = lines
        begin = next(k for k, line in enumerate(rest) if line.startswith("- "))
        rows = (re.split(r"\s{2,}", line.strip()) for line in rest[:begin])
        words = " ".join(line.strip() for line in rest[begin:])
        return exit_status, heading, {what: cells for what, *cells in rows}, words

    return run


def test_with_a_given_margin_only_certificates_promise_anything(check):
    exit_status, heading, table, words = check("one-on-one", "--strict")
    assert exit_status == 0
    answer = "a run can end guaranteed: every pair is certified at the start"
    assert heading == f"one-on-one: {answer}"
    assert table["relative degree q"][0] == "1"
    assert table["agents certified at the start"] == ["1", "all 1"]
    assert table["gaps in the theorem's proof"] == ["1", "none", "Th. 2"]
    assert table["largest h at the start"] == ["-1.89 m²", "at most 0", "(2)"]
    formula, least, equation = table["margin η, by the formula"]
    assert (formula, equation) == ("0.3 m²/s", "(24)")
    assert re.fullmatch(r"at least [\d. ]+ m²/s", least)
    assert table["worst joint condition on ∂S_I"] == ["0.3 m²/s", "at most 0", "Th. 3 (33)"]
    assert "proves nothing here: the margin η is a given number" in words


def test_without_certificates_at_the_start_strict_makes_a_failure(check):
    """The other, at 5 m/s, arrives before the next sample."""
    chased = ["--set", "agents.1.start=[[0.0, -1.02]]", "--set", "agents.1.dynamics.speed=5.0"]
    relaxed, heading, table, words = check("one-on-one", *chased)
    assert relaxed == 0
    assert check("one-on-one", *chased, "--strict")[0] == 1
    answer = "a run cannot end guaranteed: no certificate covers its start"
    assert heading == f"one-on-one: {answer}"
    assert table["agents certified at the start"] == ["0, not 1", "all 1"]
    assert "- No guarantee: at the start 1 has no input" in words


def test_a_start_too_near_is_named_with_the_agent_that_has_no_solution(check):
    """h = 1 - 1.05² = -0.1025, and α(h) + η > 0."""
    _, _, table, words = check("one-on-one", "--set", "agents.1.start=[[0.0, -1.05]]")
    assert table["largest h at the start"][0] == "-0.103 m²"
    assert table["agents with an input in K_i"] == ["0, not 1", "all 1", "(30)"]
    assert "- At the start no input satisfies the rows of 1 " in words


def test_nothing_keeps_the_guaranteed_scenario_from_its_guarantee(check):
    exit_status, heading, table, words = check("guaranteed", "--strict")
    assert exit_status == 0
    assert heading.startswith("guaranteed: a run can end guaranteed")
    assert table["gaps in the theorem's proof"] == ["none", "none", "Th. 2"]
    assert table["margin η, at the start"][1:] == ["any bound", "(24)"]
    assert "No guarantee" not in words


def test_what_is_missing_is_named_with_its_setting(check):
    """A velocity has no bounds of its own, without which there is no workspace."""
    _, _, table, words = check("disturbance-gap")
    assert table["largest ψ_1 at the start"] == ["-74.2 m²/s", "at most 0", "(38)"]
    assert table["margin η, by the formula"] == ["0.5 m²/s²", "set [workspace]", "(42)"]
    assert table["worst joint condition on ∂S_I"] == [
        "not computed",
        "set [workspace]",
        "Th. 3 (33)",
    ]
    assert "give bounds for vx, vy, vz in [workspace]" in words


def test_it_says_at_once_on_standard_error_what_it_does(capsys):
    assert status(["check", "one-on-one"]) == 0
    printed = capsys.readouterr()
    assert printed.err.startswith("checking one-on-one: rows\n")
    assert "checking" not in printed.out


def test_an_unsafe_start_is_foretold(check):
    _, heading, _, words = check("one-on-one", "--set", "agents.1.start=[[0.0, -0.9]]")
    assert heading == "one-on-one: a run will end violated: a pair is unsafe at the start"
    assert "No guarantee: some pair is unsafe at the start" in words
    assert "outside S_I" in words


@pytest.mark.parametrize("composition", ["lse", "pairs"])
def test_table_and_sentence_have_one_number_for_the_margin_needed(check, composition):
    """The formula gives one pair less than all together."""
    _, _, table, words = check("faults/hijack", "--set", f"safety.composition={composition}")
    value, least, _ = table["margin η, by the formula"]
    number = least.removeprefix("at least ").removesuffix(" m²/s")
    assert f"The margin η = {value.removesuffix(' m²/s')} is below the {number} of the" in words


def test_what_does_not_hold_is_yellow_and_nothing_else(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert status(["check", "unicycles"]) == 0
    rows = [line for line in capsys.readouterr().out.splitlines() if "\x1b[33m" in line]
    names = {re.split(r"\s{2,}", line)[0] for line in rows}
    assert names == {row.name for row in checked("unicycles").table if not row.holds} == {
        "agents with an input in K_i",
        "margin η, by the formula",
        "margin η, as a bound",
        "worst joint condition on ∂S_I",
        "an input is in force for",
        "gaps in the theorem's proof",
    }  # fmt: skip
