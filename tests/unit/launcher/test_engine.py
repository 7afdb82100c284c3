"""Engines by name, the options of a run, and libraries that are loaded ahead of it."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import phalanx
from phalanx.cli.app import USAGE_ERROR, status
from phalanx.launcher.engine import ENGINES, EngineEntry, RunOptions
from phalanx.launcher.libraries import _PROGRAMS
from phalanx.launcher.processes import _may_lose
from phalanx.launcher.programs import PROGRAMS
from tests.unit.report.recordings import drift, record, summary_of, unicycles

TRIAL = """
from dataclasses import replace

from phalanx.launcher.engine import execute

asked = []

def run(scenario, make_folder, options):
    asked.append(options)
    return execute(scenario, make_folder, replace(options, engine="in-process"))
"""


@pytest.mark.slow
def test_an_unknown_engine_is_refused_with_a_list_of_engines(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    expected = "expected 'processes' or 'in-process' or 'native' or 'auto', got 'warp'"
    run = phalanx.run("pinned", engine="in-process", out=tmp_path)
    with pytest.raises(ValueError, match=expected):
        phalanx.run("pinned", engine="warp")
    with pytest.raises(ValueError, match=expected):
        phalanx.verify(run, engine="warp")
    for command in (["run", "pinned"], ["verify", str(run.folder)]):
        assert status([*command, "--engine", "warp"]) == USAGE_ERROR
        # In a terminal the message is broken into lines.
        assert expected in " ".join(capsys.readouterr().err.replace("│", " ").split())


KILL = {"kind": "kill", "at": 0.5, "agents": ["1"]}
SCHEDULED = (phalanx.Command(0.5, phalanx.CommandKind.KILL, "1"),)


@pytest.mark.parametrize(
    ("options", "fault", "may"),
    [
        ({}, {"kind": "turn", "at": 0.5, "agents": ["1"]}, False),
        ({}, KILL, True),
        ({"commands": phalanx.CommandPolicy(schedule=SCHEDULED)}, None, True),
        ({"commands": phalanx.CommandPolicy(secret=b"s")}, None, True),
        ({"real_time": 1.0}, None, True),
    ],
)
def test_a_run_survives_the_death_of_a_process_that_it_may_have_killed(options, fault, may):
    scenario = phalanx.load("unicycles", {"faults": [fault] if fault else []})
    assert _may_lose(scenario, RunOptions("processes", **options)) == may


@pytest.mark.slow
def test_an_engine_is_one_function_and_one_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "trial_engine.py").write_text(TRIAL)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setitem(ENGINES, "trial", EngineEntry("trial_engine:run", "for a test"))
    run = phalanx.run("pinned", engine="trial", out=tmp_path)
    assert phalanx.verify(run, engine="trial")
    command = ["run", "pinned", "--engine", "trial", "--no-report", "--out", str(tmp_path)]
    assert status(command) == 2
    assert [o.engine for o in sys.modules["trial_engine"].asked] == ["trial"] * 3
    assert status([*command, "--view"]) == USAGE_ERROR


@pytest.mark.parametrize(
    "option",
    [
        {"listen": "tcp/127.0.0.1:7447"},
        {"secret": b"s"},
        {"announce": print},
        {"commands": phalanx.CommandPolicy(secret=b"s")},
    ],
)
def test_an_engine_without_a_hub_refuses_what_needs_one(option: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="engine 'in-process' has no hub"):
        RunOptions("in-process", **option)
    RunOptions(**option)


@pytest.mark.parametrize(("engine", "factor"), [("in-process", 1.0), ("processes", 0.0)])
def test_real_time_needs_a_hub_and_a_factor_at_which_time_goes_on(
    engine: str, factor: float
) -> None:
    with pytest.raises(ValueError, match="above 0 and at most 1000, and engine 'processes'"):
        RunOptions(engine, real_time=factor)


def test_who_watches_in_real_time_needs_a_latency_to_hold_others_to() -> None:
    watching = {"safety.watch": True}
    scenario = phalanx.load("unicycles", watching)
    scenario.require_clock(None)
    with pytest.raises(ValueError, match=r"without a time\.latency"):
        scenario.require_clock(1.0)
    phalanx.load("unicycles", {**watching, "time.latency": 0.005}).require_clock(1.0)


def test_options_that_hold_secrets_do_not_print_them() -> None:
    options = RunOptions(secret=b"hush", commands=phalanx.CommandPolicy(secret=b"hush"))
    assert "hush" not in repr(options)


ASKS = """
import os
from phalanx.launcher.libraries import start_process

if __name__ == "__main__":
    start_process(print, "there").join()
    print(os.environ.get("PYTHONPATH"), os.environ.get("PYTHONSAFEPATH"))
"""
WRONG = 'print("the wrong phalanx", flush=True)\n'


def test_every_program_is_loaded_ahead():
    assert {place.partition(":")[0] for place in PROGRAMS} <= set(_PROGRAMS)
    for name in _PROGRAMS:
        import_module(name)  # multiprocessing ignores a module that cannot be imported


@pytest.mark.slow
def test_it_is_loaded_from_where_the_launcher_has_it_and_not_from_the_working_directory(
    tmp_path: Path,
) -> None:
    script, elsewhere = tmp_path / "script" / "asks.py", tmp_path / "elsewhere"
    (elsewhere / "phalanx").mkdir(parents=True)
    (elsewhere / "phalanx" / "__init__.py").write_text(WRONG)
    script.parent.mkdir()
    script.write_text(ASKS)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    environment["PYTHONPATH"] = str(Path(__file__).parents[3])
    ended = subprocess.run(
        [sys.executable, script], cwd=elsewhere, env=environment, capture_output=True, text=True
    )
    assert ended.stdout == f"there\n{environment['PYTHONPATH']} None\n", ended.stderr


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
