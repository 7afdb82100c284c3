"""Attacks that ship: each gives the verdict and the trajectory that its file states."""

import re
from pathlib import Path

import pytest
from phalanx_attacks.minimise import _left_out, _sides, differences, smallest, stated
from phalanx_attacks.robustness import nearest

from phalanx.cli.app import status
from phalanx.guarantee.start import promised
from phalanx.guarantee.verdict import Violation
from phalanx.scenario.load import load, read_table, scenario_text
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import build_swarm
from tests.layers import layered

from .weak_swarm import weak

ROOT = Path(__file__).parents[3]
CORPUS = sorted((ROOT / "scenarios" / "attacks").glob("*.toml"))
PAGE = ROOT / "docs" / "found-attacks.md"


@pytest.mark.parametrize("file", layered(CORPUS, CORPUS[:1]), ids=[file.stem for file in CORPUS])
def test_an_attack_repeats_itself_on_both_engines(file: Path) -> None:
    assert differences(file, ["in-process", "processes"]) == []


@pytest.mark.parametrize("file", CORPUS, ids=[file.stem for file in CORPUS])
def test_an_attack_stands_on_the_page(file: Path) -> None:
    assert stated(file).verdict == "violated"
    assert f"`attacks/{file.stem}` | `{stated(file).attacked}`" in PAGE.read_text(encoding="utf-8")


def test_an_attack_that_states_something_else_is_found_out(tmp_path: Path) -> None:
    text = CORPUS[0].read_text(encoding="utf-8")
    other = tmp_path / "other.toml"
    other.write_text(text.replace("duration = 3.0", "duration = 0.5"), encoding="utf-8")
    complaints = differences(other, ["in-process"])
    assert len(complaints) == 2
    assert "expected the verdict violated, got" in complaints[0]
    assert f"expected the trajectory {stated(CORPUS[0]).trajectory}, got" in complaints[1]


def test_a_scenario_that_states_nothing_is_no_attack(tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text("name = 'other'\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match="expected a comment '# Verdict: "):
        stated(other)
    with pytest.raises(ScenarioError, match=r"none.toml: cannot be read"):
        differences(tmp_path / "none.toml", ["in-process"])


@pytest.mark.nightly
def test_an_attack_that_ships_shrinks_no_further() -> None:
    file = next(file for file in CORPUS if file.stem == "turned-away")
    minimum = smallest(read_table(file), read_table("guaranteed"))
    shipped = read_table(file)
    assert shipped.pop("description").startswith("An attack on guaranteed: normal agent 2 and ")
    assert minimum.table == shipped
    assert minimum.evaluation.summary.trajectory == stated(file).trajectory


@pytest.mark.slow
def test_an_attack_is_shrunk_into_a_file_that_states_its_run(tmp_path: Path, capsys) -> None:
    table = weak()
    table["agents"][1]["start"] = [[1.234567, -1.345678]]
    attack, small = tmp_path / "attack.toml", tmp_path / "small.toml"
    attack.write_text(scenario_text(table), encoding="utf-8")
    words = ["shrink", str(attack), "--attacked", str(attack)]
    assert status([*words, "--out", str(small)]) == 0
    assert capsys.readouterr().out.startswith(f"{small}: ")
    assert differences(small, ["in-process"]) == []
    assert read_table(small)["agents"][1]["names"] == ["2"]
    text = small.read_text(encoding="utf-8")
    assert "adversary 2" in text
    assert nearest(build_swarm(load(small)))[0] >= 1.8, "it was 1.826 m"
    assert f"Run it: phalanx run {small}" in text
    assert re.search(r"^# Certificates proved it until \d\.\d{3} s\.$", text, re.MULTILINE)
    promise = promised(build_swarm(load(small))).time
    stated_promise = float(re.search(r"promises safety for (\d+\.\d+) s", text)[1])
    assert promise - 1e-3 < stated_promise <= promise
    assert status(["shrink", str(small), "--attacked", str(attack)]) == 0
    assert "# Verdict: violated" in capsys.readouterr().out


def test_a_violations_two_sides_are_those_of_its_own_pair() -> None:
    """Other pairs stand before and after it, with names before and after its own."""
    swarm = build_swarm(load("guaranteed"))
    for pair, roles in (("2-obstacle 1", ["normal", "other"]), ("2-4", ["normal", "adversary"])):
        sides = _sides(swarm, Violation(pair, 0.0, 0.1, 0.0, 0.1, 1, 0.0, None))
        assert [side.role for side in sides] == roles
        assert "-".join(side.label for side in sides) == pair


def test_what_an_attack_has_no_more_is_said_in_words() -> None:
    origin = {"name": "a", "duration": 1.0, "obstacles": [], "agents": [
        {"names": ["1", "2"], "role": "normal"}, {"names": ["3"], "spread": [], "role": "normal"},
    ]}  # fmt: skip
    shrunk = {"name": "a", "duration": 1.0, "agents": [{"names": ["2"], "role": "normal"}]}
    assert _left_out(shrunk, origin) == ["agent 1", "agent 3", "obstacles", "spread of agents"]
    assert _left_out(origin, origin) == []


def test_what_is_not_violated_is_not_shrunk() -> None:
    table = read_table("one-on-one") | {"duration": 0.2}
    with pytest.raises(ScenarioError, match="one-on-one: expected a violated run, got guaranteed"):
        smallest(table, table)
