"""The table of a study: the rows of its plan, and the rates that they give."""

import json
import re

import pytest
from phalanx_studies.plan import Plan, plan_from
from phalanx_studies.row import Identity, Row, without_effect
from phalanx_studies.store import Store
from phalanx_studies.study import Study, open_study, study

from phalanx.cli.app import USAGE_ERROR, status
from phalanx.scenario.load import read_table, scenario_text
from phalanx.scenario.model import ScenarioError


def studied(folder, plan: Plan, outcomes: dict[int, str], **fields: object) -> Study:
    """Return a study with rows of these outcomes, by their place in the plan."""
    with Store(folder).open(plan) as store:
        for index, outcome in outcomes.items():
            case = plan.case(index)
            identity = Identity(str(case.point.number), case.seed, "", "")
            row = Row(
                identity=identity, overrides=case.point.overrides, outcome=outcome, reason="",
                **fields,
            )  # fmt: skip
            store.add(row)
    return open_study(folder)


def test_rates_are_of_each_point_with_their_intervals(tmp_path):
    plan = plan_from({"scenario": "unicycles", "seeds": "0:10", "vary": {"network.loss": [0, 0.5]}})
    outcomes = {place: "violated" if place in (3, 11, 12) else "safe" for place in range(20)}
    rates = studied(tmp_path, plan, outcomes).rates("violated")
    assert rates.select("network.loss", "runs", "violated", "rate").rows() == [
        (0.0, 10, 1, 0.1),
        (0.5, 10, 2, 0.2),
    ]
    assert rates["high"][0] == pytest.approx(0.445, abs=1e-3)  # tables of Clopper and Pearson


def test_runs_that_share_a_seed_are_no_two_draws(tmp_path):
    plan = plan_from({"scenario": "unicycles", "seeds": "0:10", "vary": {"network.loss": [0, 0.5]}})
    study = studied(tmp_path, plan, dict.fromkeys(range(20), "safe"))
    alone = study.rates("violated")["high"].max()
    assert study.rates("violated", by=[])["high"][0] > alone


@pytest.mark.slow
def test_rows_are_confirmed_over_processes_by_their_hashes(tmp_path, capsys):
    words = "one-on-one", "--seeds", "0:2", "--set", "duration=0.05", "--confirm", "0.5"
    assert status(["study", *words, "--out", str(tmp_path / "true")]) == 0
    assert "over processes 1 of 1 rows have the same hash" in capsys.readouterr().out
    plan = open_study(tmp_path / "true").plan
    false = studied(tmp_path / "false", plan, {0: "safe"}, trajectory="another")
    assert false.confirm(0.5) == {0: False}


def test_refused_and_searched_rows_enter_no_rate(tmp_path):
    plan = plan_from({"scenario": "unicycles", "seeds": "0:4"})
    study = studied(tmp_path, plan, {0: "safe", 1: "violated", 2: "refused"})
    assert study.rates("violated")["runs"].to_list() == [2]
    assert study.missing == 1
    searched = studied(tmp_path, plan, {3: "violated"}, searched=True)
    assert searched.rates("violated")["runs"].to_list() == [2]
    assert len(searched.frame) == 4


@pytest.mark.slow
def test_a_field_that_only_some_points_set_is_a_column_of_numbers(tmp_path):
    points = [{"safety.eta": 1.0, "safety.margin": "paper"}, {"safety.margin": "local"}]
    plan = plan_from({"scenario": "guaranteed", "points": points})
    study = studied(tmp_path, plan, {0: "safe", 1: "safe"})
    assert study.frame["safety.eta"].to_list() == [1.0, None]
    assert study.rates().height == 2
    assert study.page(tmp_path / "page.html").stat().st_size > 1000


def test_a_page_lists_points_whose_scenario_is_not_valid(tmp_path):
    plan = plan_from({"scenario": "unicycles", "vary": {"network.loss": [0.0, 1.5]}})
    page = studied(tmp_path, plan, {0: "safe", 1: "refused"}).page(tmp_path / "page.html")
    assert "phalanx run unicycles --seed 0 --set network.loss=1.5" in page.read_text("utf-8")


def test_a_scenario_whose_file_ends_like_a_plans_is_a_scenario(tmp_path):
    file = tmp_path / "case-study.toml"
    file.write_text(scenario_text(read_table("unicycles")))
    with pytest.raises(ScenarioError, match=r"network\.los: unknown field"):
        study(file, overrides={"network.los": 0.0})


def test_faults_that_vary_are_distinct_from_those_that_had_an_effect(tmp_path):
    kill = [{"kind": "kill", "agents": ["1"], "at": 0.5}]
    plan = plan_from({"scenario": "unicycles", "vary": {"faults": [[], kill]}})
    faulty = studied(tmp_path, plan, {0: "safe", 1: "safe"}, faults="faults.0 (kill)")
    assert faulty.frame["faults"].to_list() == [json.dumps([]), json.dumps(kill)]
    assert faulty.frame["faults_acted"].to_list() == ["faults.0 (kill)"] * 2
    page = faulty.page(tmp_path / "page.html").read_text("utf-8")
    (head,) = re.findall(r">index<.*?</tr>", page, re.DOTALL)
    assert head.count(">faults<") == 1


def with_trajectories(folder, axes: dict, trajectory) -> Study:
    """Return a study of two seeds; trajectory: of the point's values and the seed."""
    plan = plan_from({"scenario": "unicycles", "seeds": "0:2", "vary": axes})
    with Store(folder).open(plan) as store:
        for case in plan.cases():
            identity = Identity(str(case.point.number), case.seed, "", "")
            fields = {"overrides": case.point.overrides, "outcome": "safe", "reason": ""}
            digest = trajectory(*case.point.axes.values(), case.seed)
            store.add(Row(identity=identity, trajectory=str(digest), **fields))
    return open_study(folder)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("trajectory", "idle"),
    [
        (lambda loss, rho, seed: (loss, seed), ["safety.rho"]),
        (lambda loss, rho, seed: (loss, rho), []),
        (lambda loss, rho, seed: seed, ["network.loss", "safety.rho"]),
        (lambda loss, rho, seed: rho if seed else loss, []),
        (lambda loss, rho, seed: "", []),  # no run came to an end
    ],
)
def test_an_axis_that_changes_no_trajectory_is_named(tmp_path, capsys, trajectory, idle):
    axes = {"network.loss": [0.0, 0.5], "safety.rho": [4.0, 5.0]}
    study = with_trajectories(tmp_path, axes, trajectory)
    assert status(["study", "open", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    page = study.page(tmp_path / "page.html").read_text("utf-8")
    for text in (printed, page):
        fields = re.findall(r"([\w.]+) changes no trajectory", text)
        assert fields == idle


def test_an_axis_with_one_value_or_in_no_grid_is_not_called_idle(tmp_path):
    study_of_one_value = with_trajectories(
        tmp_path / "one", {"network.loss": [0.5]}, lambda loss, seed: seed
    )
    assert not list(without_effect(study_of_one_value.frame, study_of_one_value.axes))
    points = [{"network.loss": 0.1, "safety.rho": 4.0}, {"network.loss": 0.2, "safety.rho": 5.0}]
    plan = plan_from({"scenario": "unicycles", "points": points})
    study_of_points = studied(tmp_path / "drawn", plan, {0: "safe", 1: "safe"}, trajectory="a")
    assert not list(without_effect(study_of_points.frame, study_of_points.axes))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("unicycles", "--vary", "network.los=0"), "network.los: unknown field"),
        (("unicycles", "--vary", "network.loss"), "--vary network.loss: expected PATH=VALUES"),
        (("unicycles", "--draw", "network.loss=normal(0,1)"), "expected uniform(a,b)"),
        (("unicycles", "--seeds", "many"), "study: seeds: expected seeds as 0:200 or 1,2,5"),
        (("unicycle",), "did you mean 'unicycles'?"),
        (("open",), "expected the folder of a study"),
        (("study.toml", "--seeds", "0:1000"), "study.toml has the whole plan: expected no seeds"),
        (("unicycles", "here"), "expected after `phalanx study open`"),
        (("open", "nowhere"), "study.toml: cannot be read"),
    ],
)
def test_a_wrong_word_is_refused_in_one_line(words, message, tmp_path, capsys):
    out = () if words[0] == "open" else ("--out", str(tmp_path / "study"))
    assert status(["study", *words, *out]) == USAGE_ERROR
    assert message in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "study").exists()
