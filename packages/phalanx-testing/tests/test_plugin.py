"""The plugin in projects of others: fixtures, the mark, failures, regressions, properties."""

import ast
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from xml.etree import ElementTree

import pytest
from phalanx_testing.pytest import failure

from phalanx.scenario.load import scenario_text

from .crossing import CROSSING, UNFILTERED

pytest_plugins = ["pytester"]

EXAMPLE = Path(__file__).parents[3] / "examples" / "testing" / "test_unicycles.py"
SHRINKING = Path(__file__).parents[2] / "phalanx-attacks" / "pyproject.toml"
PROJECT = f"""
import pytest
CROSSING, UNFILTERED = {CROSSING!r}, {UNFILTERED!r}
"""
FAILING = """
def test_crossing(phalanx_run):
    phalanx_run(CROSSING, overrides=UNFILTERED).assert_safe()
"""


def options(*others: str) -> list[str]:
    """Return the options of a session that loads the plugin, whether it is installed or not."""
    installed = any(entry.name == "phalanx" for entry in entry_points(group="pytest11"))
    return [
        *([] if installed else ["-p", "phalanx_testing.pytest.plugin"]),
        "-p",
        "no:timeout",
        *others,
    ]


def run(pytester: pytest.Pytester, test: str, *others: str) -> pytest.RunResult:
    pytester.makepyfile(test_swarm=PROJECT + test)
    return pytester.runpytest_inprocess(*options(*others))


@pytest.mark.slow
def test_a_test_of_a_swarm_under_faults_passes(pytester):
    test = """
from phalanx_testing import partition

def test_crossing(phalanx_run):
    phalanx_run(CROSSING, loss=0.3, faults=[partition(["a"], at=0.5, for_=0.2)]).assert_guaranteed()
"""
    run(pytester, test).assert_outcomes(passed=1)


@pytest.mark.slow
def test_a_failure_says_pair_time_and_how_to_repeat_it(pytester):
    result = run(pytester, FAILING)
    result.assert_outcomes(failed=1)
    result.stdout.re_match_lines_random(
        [
            r"E .*ClaimError: assert_safe\(\): violated: a-b left the safe set",
            r"worst h: \S+ of a-b at t = \d\.\d+ s",
            r"replay: phalanx run .*scenario\.toml",
            r"report: phalanx report .*",
        ]
    )
    replay = next(line for line in result.outlines if line.startswith("replay: "))
    command = [sys.executable, "-m", *replay.removeprefix("replay: ").split()]
    again = subprocess.run([*command, "--engine", "in-process"], capture_output=True, text=True)
    assert again.returncode == 2, again.stderr
    assert "violated" in again.stdout + again.stderr


@pytest.mark.slow
def test_a_failure_is_kept_as_a_regression_where_a_folder_is_named(pytester):
    pytester.makeini("[pytest]\nphalanx_scenarios = kept\n")
    run(pytester, FAILING, "--phalanx-artifacts", "artifacts").assert_outcomes(failed=1)
    assert list(pytester.path.glob("artifacts/*/*/recording.mcap"))
    assert list(pytester.path.glob("artifacts/*/*/report.html"))
    assert len(list(pytester.path.glob("kept/crossing-pair-*.toml"))) == 1
    again = pytester.runpytest_inprocess(*options("kept"))
    again.assert_outcomes(failed=1)
    again.stdout.fnmatch_lines(["*assert_safe()*", "replay: phalanx run *kept*"])
    assert len(list(pytester.path.glob("kept/*"))) == 1  # it is not kept again
    pytester.makepyfile(test_swarm=PROJECT + FAILING.replace("assert_safe()", "summary"))
    pytester.runpytest_inprocess(*options("kept")).assert_outcomes(passed=1)
    pytester.makepyfile(test_swarm="")
    gone = pytester.runpytest_inprocess(*options("kept"))
    gone.assert_outcomes(failed=1)
    gone.stdout.fnmatch_lines(["*not found: *test_swarm.py::test_crossing*"])
    pytester.makeini("[pytest]\n")
    pytester.runpytest_inprocess(*options("kept")).assert_outcomes()


@pytest.mark.slow
def test_a_failed_predicate_is_kept_with_its_test_and_a_scenario_alone_has_to_be_safe(pytester):
    test = """
def test_crossing(phalanx_run):
    run = phalanx_run(CROSSING, overrides={"duration": DURATION})
    run.assert_never(lambda now: now.t > 0.3)
"""
    pytester.makeini("[pytest]\nphalanx_scenarios = kept\n")
    run(pytester, "DURATION = 0.5" + test).assert_outcomes(failed=1)
    (pytester.path / "kept" / "safe.toml").write_text(scenario_text(CROSSING))
    # The test's own scenario is safe now, that of the regression is not.
    result = run(pytester, "DURATION = 0.2" + test, ".")
    result.assert_outcomes(passed=2, failed=1)
    result.stdout.fnmatch_lines(["*assert_never(predicate=<lambda>): true at t = 0.3*"])


LIVE = """
def test_live(phalanx_live):
    live = phalanx_live(CROSSING)
    live.until(0.2)
    {}
    assert live.t > 1.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("finished", [True, False])
def test_a_live_run_is_in_the_properties_and_in_the_failure(pytester, finished):
    pytester.makeini("[pytest]\nphalanx_scenarios = kept\n")
    test = LIVE.format("live.finish()" if finished else "").replace("1.0", "1e9")
    result = run(pytester, test, "--junitxml=junit.xml")
    result.assert_outcomes(failed=1)
    verdict = "guaranteed" if finished else "stopped"
    result.stdout.fnmatch_lines([f"verdict: {verdict}: *", "replay: phalanx run *"])
    cases = ElementTree.parse(pytester.path / "junit.xml").getroot().iter("testcase")
    properties = {p.get("name"): p.get("value") for p in next(cases).iter("property")}
    assert properties["phalanx_verdict"] == verdict
    assert len(properties["phalanx_trajectory"]) == 64
    assert len(list(pytester.path.glob("kept/*"))) == 1


@pytest.mark.slow
def test_a_live_run_with_commands_is_not_said_to_be_that_of_its_scenario(pytester):
    pytester.makeini("[pytest]\nphalanx_scenarios = kept\n")
    result = run(pytester, LIVE.format("live.command('kill', 'a'); live.until(0.4)"))
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["replay: the test itself, *", "*phalanx verify *"])
    result.stdout.no_fnmatch_line("replay: phalanx run*")


@pytest.mark.slow
def test_the_mark_makes_a_test_of_each_seed_and_value(pytester):
    test = """
@pytest.mark.phalanx(seeds=[3, 5], vary={"duration": [0.1, 0.2]})
def test_crossing(phalanx_run):
    run = phalanx_run(CROSSING)
    print("RAN", run.scenario.seed, run.scenario.duration)
"""
    result = run(pytester, test, "-s", "-k", "not seed:5-duration:0.2", "--junitxml=junit.xml")
    result.assert_outcomes(passed=3, deselected=1)
    assert {line[-5:] for line in result.outlines if "RAN" in line} == {"3 0.1", "3 0.2", "5 0.1"}
    cases = ElementTree.parse(pytester.path / "junit.xml").getroot().iter("testcase")
    properties = {p.get("name"): p.get("value") for p in next(cases).iter("property")}
    assert properties["phalanx_verdict"] == "guaranteed"
    assert properties["phalanx_seed"] == "3"


def test_a_mark_without_a_fixture_is_an_error(pytester):
    result = run(pytester, "@pytest.mark.phalanx(seeds=2)\ndef test_nothing(): pass\n")
    assert result.ret != 0
    result.stdout.fnmatch_lines(["*mark phalanx needs phalanx_live or phalanx_run*"])


@pytest.mark.slow
def test_it_works_with_xdist(pytester):
    test = '@pytest.mark.phalanx(seeds=2, vary={"duration": [1.0]})' + FAILING
    pytester.makepyfile(test_swarm=PROJECT + test)
    result = pytester.runpytest_subprocess(*options("-n", "2"))
    result.assert_outcomes(failed=2)
    result.stdout.fnmatch_lines(["replay: phalanx run *"])


@pytest.mark.slow
def test_the_example_of_the_page_passes(pytester):
    pytester.makepyfile(test_unicycles=EXAMPLE.read_text("utf-8"))
    pytester.runpytest_inprocess(*options("-k", "seed:0")).assert_outcomes(passed=1, deselected=1)


def sources(folder: Path, *others: str) -> dict[str, int]:
    """Return the bytes of each module of a session that collects nothing."""
    code = (
        "import sys, pytest, os; pytest.main(sys.argv[1:]); files = ((n, getattr(m, '__file__', 0))"
        " for n, m in list(sys.modules.items())); print({n: os.path.getsize(f) for n, f in files"
        " if str(f).endswith('.py')})"
    )
    command = [sys.executable, "-c", code, "--collect-only", "-q", "-p", "no:timeout", *others]
    result = subprocess.run([*command, folder], capture_output=True, text=True, cwd=folder)
    sizes: dict[str, int] = ast.literal_eval(result.stdout.splitlines()[-1])
    return sizes


@pytest.mark.slow
def test_a_session_without_a_swarm_imports_less_than_a_hundredth_more(tmp_path):
    without = sources(tmp_path, "-p", "no:phalanx")
    loaded = sources(tmp_path, "-p", "phalanx_testing.pytest.plugin")
    more = {name: size for name, size in loaded.items() if name not in without}
    plugin = "phalanx_testing.pytest.plugin"
    assert set(more) == {"phalanx", "phalanx_testing", "phalanx_testing.pytest", plugin}
    assert sum(more.values()) < 0.01 * sum(without.values())


@pytest.mark.slow
def test_a_law_of_the_test_module_is_an_object(pytester):
    test = """
from dataclasses import dataclass
import numpy as np

@dataclass
class Still:
    def prepare(self, dynamics): pass
    def input(self, view): return np.zeros(2)

def test_standing(phalanx_run):
    run = phalanx_run(CROSSING, overrides={"agents.0.law": Still(), "duration": 0.2})
    run.assert_never(lambda now: abs(now.states["a"][0] + 1.5) > 1e-9)

def test_in_a_function(phalanx_run):
    @dataclass
    class Hidden(Still): pass
    phalanx_run(CROSSING, overrides={"agents.0.law": Hidden()})
"""
    result = run(pytester, test)
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(["*Hidden is made in a function*"])


@pytest.mark.slow
def test_a_failure_is_shrunk_before_it_is_kept(pytester, monkeypatch):
    declared = tomllib.loads(SHRINKING.read_text("utf-8"))["project"]["entry-points"]
    target = declared["phalanx.extensions"]["shrink"]
    smallest = EntryPoint("shrink", target, "phalanx.extensions").load()
    monkeypatch.setattr(failure, "extension", lambda name: smallest)
    pytester.makeini("[pytest]\nphalanx_scenarios = kept\n")
    result = run(pytester, FAILING, "--phalanx-shrink")
    result.assert_outcomes(failed=1)
    result.stdout.re_match_lines_random([r"shrunk: \d+ values instead of \d+, after \d+ runs"])
    (file,) = pytester.path.glob("kept/*.toml")
    assert tomllib.loads(file.read_text("utf-8"))["duration"] < 3.0
