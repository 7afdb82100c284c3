"""pytest's option --phalanx-shrink has the scenario of a violated run shrunk."""

import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from phalanx.testing.pytest import failure
from tests.unit.testing.test_plugin import FAILING, run

pytest_plugins = ["pytester"]
PROJECT = Path(__file__).parents[1] / "pyproject.toml"


@pytest.mark.slow
def test_a_failure_is_shrunk_before_it_is_kept(pytester, monkeypatch):
    declared = tomllib.loads(PROJECT.read_text("utf-8"))["project"]["entry-points"]
    target = declared["phalanx.extensions"]["shrink"]
    smallest = EntryPoint("shrink", target, "phalanx.extensions").load()
    monkeypatch.setattr(failure, "extension", lambda name: smallest)
    pytester.makeini("[pytest]\nphalanx_scenarios = kept\n")
    result = run(pytester, FAILING, "--phalanx-shrink")
    result.assert_outcomes(failed=1)
    result.stdout.re_match_lines_random([r"shrunk: \d+ values instead of \d+, after \d+ runs"])
    (file,) = pytester.path.glob("kept/*.toml")
    assert tomllib.loads(file.read_text("utf-8"))["duration"] < 3.0
