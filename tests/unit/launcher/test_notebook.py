"""Scenario, check and summary in a notebook; and mistakes that are rejected before a run."""

from pathlib import Path

import pytest

import phalanx
from tests.unit.report.recordings import drift, record, summary_of, unicycles


@pytest.mark.slow
def test_a_scenario_a_check_and_a_summary_say_what_they_are() -> None:
    scenario = phalanx.load("one-on-one", seed=4)
    assert repr(scenario) == str(scenario)
    assert repr(scenario) == "Scenario('one-on-one', 1 normal and 1 adversary agents, 20 s, seed 4)"
    answer, *words = repr(phalanx.check(scenario)).split("\n")
    assert answer == "a run can end guaranteed: every pair is certified at the start"
    assert words
    assert all(line.startswith("- ") for line in words)
    text = repr(summary_of(scenario, "too\x1b[2J close"))
    assert text == (
        r"Summary(violated after 20 s: 'too\x1b[2J close', worst h 0.25 of 1-4 at t = 0.300 s)"
    )


@pytest.mark.slow
def test_a_notebook_shows_them_as_tables_with_every_text_escaped() -> None:
    scenario = phalanx.load("one-on-one", {"description": "x<y>"}, seed=4)
    html = scenario._repr_html_()
    assert html.startswith("<p>one-on-one: x&lt;y&gt;, 20 s, seed 4</p><table>")
    assert "1 normal" in html
    assert "10 ms" in html
    report = phalanx.check(scenario)
    assert report._repr_html_().startswith(f"<p><b>{report.answer}</b></p><ul><li>")
    summary = summary_of(scenario, "too <i>close")._repr_html_()
    assert "too &lt;i&gt;close" in summary
    assert "0.25 of 1-4 at t = 0.300 s" in summary


@pytest.mark.slow
def test_a_large_group_is_named_by_its_first() -> None:
    shown = phalanx.load("swarm2d")._repr_html_()
    assert "10, 11, 12, ...</th><td" in shown
    assert "14 normal" in shown


def test_what_is_no_function_is_refused_before_anything_is_made(tmp_path: Path) -> None:
    refused = pytest.raises(ValueError, match="expected a function to call, got True")
    with refused:
        phalanx.run("one-on-one", progress=True, out=tmp_path / "runs")
    with refused:
        phalanx.run("one-on-one", announce=True, out=tmp_path / "runs")
    assert list(tmp_path.iterdir()) == []
    scenario = unicycles()
    run = phalanx.open(record(tmp_path, scenario, drift(scenario), summary_of(scenario)))
    with refused:
        run.report(progress=True)
    with refused:
        phalanx.verify(run, progress=True)
