"""The example of docs/your-own.md, taken from the page as it stands."""

import re
from pathlib import Path

import pytest

import phalanx
from phalanx.guarantee.verdict import Outcome
from phalanx.scenario.load import load
from phalanx.swarm.rows import build_rows
from phalanx.swarm.swarm import build_swarm

PAGE = Path(__file__).parents[2] / "docs" / "your-own.md"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    text = PAGE.read_text(encoding="utf-8")
    names = re.findall(r"^`(\w[^`]+)`", text, flags=re.MULTILINE)
    blocks = re.findall(r"```\w+\n(.*?)```", text, flags=re.DOTALL)
    for name, block in zip(names, blocks, strict=True):
        (tmp_path / name).write_text(block, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_of_ones_own_is_under_40_lines_and_its_relative_degree_is_found(folder):
    swarm = build_swarm(load("regatta.toml"))
    assert build_rows(swarm).chain.relative_degree == 2
    assert type(swarm.members[0].dynamics).__name__ == "Boat"
    for file in ("boats.py", "lanes.py", "pools.py"):
        assert len((folder / file).read_text().splitlines()) < 40


@pytest.mark.swarm
def test_it_runs_by_name_from_a_scenario(folder):
    summary = phalanx.run(phalanx.load("regatta.toml", {"duration": 2.0})).summary
    assert summary.outcome is Outcome.GUARANTEED
    assert summary.origins["qp"] > 60


def test_a_limit_of_ones_own_is_a_pair_of_each_normal_agent(folder):
    limits = [{"type": "pools:Lane", "half_width": 12.0}]
    run = phalanx.run(
        phalanx.load("regatta.toml", overrides={"duration": 1.0, "limits": limits}),
        engine="in-process",
    )
    assert run.summary.outcome is Outcome.GUARANTEED
    assert run.h.columns[-2:] == ["red-limit 0", "blue-limit 0"]
    assert run.report().is_file()
