"""The plan of a study: its grid, its draws, and what it refuses."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_studies.plan import (
    Distribution,
    distribution_from,
    plan_from,
    read_plan,
    seeds_from,
    values_from,
)
from phalanx_studies.store import plan_text

from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError

LOSSES, MODELS = [0.0, 0.1, 0.3], ["paper", "split"]
GRID = {
    "scenario": "unicycles",
    "seeds": "0:4",
    "vary": {"network.loss": LOSSES, "safety.information": MODELS},
}


def test_every_point_of_the_grid_is_run_with_every_seed():
    plan = plan_from(GRID)
    found = [(*case.point.axes.values(), case.seed) for case in plan.cases()]
    assert found == list(product(LOSSES, MODELS, range(4)))
    assert [plan.case(row) for row in range(plan.size)] == list(plan.cases())


def test_a_run_that_the_plan_does_not_have_is_refused():
    with pytest.raises(ValueError, match="row: expected 0 to 23, got 24"):
        plan_from(GRID).case(24)


def test_a_draw_is_the_same_in_whatever_study_it_is():
    fields = {"safety.eta": {"log-uniform": [0.1, 10.0]}, "network.loss": {"uniform": [0, 0.5]}}
    few = plan_from({"scenario": "unicycles", "draw": fields, "draws": 8})
    other = plan_from({
        "scenario": "unicycles", "seeds": "0:3", "draws": 20,
        "draw": {"safety.eta": fields["safety.eta"]},
        "vary": {"safety.information": MODELS},
    })  # fmt: skip
    etas = [few.point(draw).axes["safety.eta"] for draw in range(8)]
    assert len(set(etas)) == 8
    for model, draw in product(range(2), range(8)):
        assert other.point(20 * model + draw).axes["safety.eta"] == etas[draw]


def test_fields_are_drawn_independently():
    unit = {"uniform": [0.0, 1.0]}
    fields = {"network.loss": unit, "safety.eta": unit}
    plan = plan_from({"scenario": "unicycles", "draw": fields, "draws": 400})
    axes = [tuple(plan.point(number).axes.values()) for number in range(plan.points_count)]
    # Five standard deviations of the correlation of independent draws.
    assert abs(np.corrcoef(np.array(axes).T)[0, 1]) < 0.25


def test_another_draw_seed_draws_others():
    table = {"scenario": "unicycles", "draw": {"safety.eta": {"uniform": [0, 1]}}}
    assert plan_from(table).point(0) != plan_from({**table, "draw_seed": 1}).point(0)


@given(quantile=st.floats(0.0, 1.0, exclude_max=True))
def test_a_drawn_value_lies_within_its_distribution(quantile):
    assert 2.0 <= Distribution.model_validate({"uniform": (2.0, 5.0)}).at(quantile) <= 5.0
    between = Distribution.model_validate({"log-uniform": (1e-3, 10.0)}).at(quantile)
    assert 1e-3 * (1 - 1e-12) <= between <= 10.0 * (1 + 1e-12)
    assert Distribution.model_validate({"choice": ("a", "b", "c")}).at(quantile) in "abc"


def test_half_of_a_log_uniform_lies_below_the_geometric_mean():
    assert Distribution.model_validate({"log-uniform": (0.01, 1.0)}).at(0.5) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            {"overrides": {"network.loss": 0}},
            "vary.network.loss: expected fields that nothing else",
        ),
        ({"overrides": {"network": {}}}, "overrides sets network"),
        ({"points": [{"network.loss": 1}]}, "vary sets network.loss"),
        ({"draw": {"safety.eta": {}}}, "draw.safety.eta: expected one of uniform"),
        ({"draw": {"safety.eta": {"uniform": [1, 0]}}}, "expected the least value first"),
        ({"draw": {"safety.eta": {"log-uniform": [0, 1]}}}, "expected positive values"),
        ({"draws": 4}, "draws: expected fields to draw"),
        ({"seeds": [1, 1]}, "seeds: expected every seed once"),
        ({"seeds": "5:2"}, "expected a first seed and a larger end"),
        ({"seeds": "all"}, "expected seeds as 0:200 or 1,2,5"),
        ({"vary": {"seed": [1]}}, "expected seeds in `seeds`"),
        ({"vary": {"network.loss": []}}, "vary.network.loss"),
        ({"colour": 1}, "colour: unknown field"),
        ({"vary": {"agents.0.sensing": [None, 5.0]}}, "vary.agents.0.sensing: expected no None"),
        ({"overrides": {"agents.0.sensing": None}}, "overrides.agents.0.sensing: expected no None"),
        ({"points": [{"agents.0.law": {"gain": None}}]}, "points.agents.0.law: expected no None"),
        ({"draw": {"safety.eta": {"choice": [1.0, None]}}}, "draw.safety.eta: expected no None"),
    ],
)
def test_a_contradiction_is_refused_by_the_name_of_its_field(table, message):
    with pytest.raises(ScenarioError, match=r"^study: ") as refused:
        plan_from({**GRID, **table})
    assert message in str(refused.value)


def test_an_axis_that_no_scenario_has_is_refused_before_the_first_run():
    plan = plan_from({"scenario": "unicycles", "vary": {"network.los": [0.0, 0.1]}})
    with pytest.raises(ScenarioError, match=r"any value of network.los: .*network.los: unknown"):
        plan.require_axes()


def test_an_axis_is_not_refused_because_of_some_of_its_values():
    plan_from({"scenario": "unicycles", "vary": {"network.loss": [0.5, 1.5]}}).require_axes()


def test_values_are_read_as_toml_and_words_as_texts():
    assert values_from("0,.1,1e-2") == [0, 0.1, 0.01]
    assert values_from("paper, split") == ["paper", "split"]
    assert values_from("[1, 2],{ low = 0.0, high = 0.1 },true") == [
        [1, 2], {"low": 0.0, "high": 0.1}, True,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("[[0,0],[1,1]],[[2,2],[3,3]]", [[[0, 0], [1, 1]], [[2, 2], [3, 3]]]),
        ('{type="pursue", gains=[1,2]}', [{"type": "pursue", "gains": [1, 2]}]),
        ("{a=1,b={c=2,d=3}},5", [{"a": 1, "b": {"c": 2, "d": 3}}, 5]),
        (r""" "a,[", 'b,"', "\",", 7 """, ["a,[", 'b,"', '",', 7]),
    ],
)
def test_values_end_at_commas_outside_brackets_and_quotes(text, values):
    assert values_from(text) == values
    assert distribution_from(f"choice({text})") == {"choice": values}


def test_seeds_are_read_as_ranges_and_numbers():
    assert seeds_from("0:3, 7,10:12") == (0, 1, 2, 7, 10, 11)


def test_distributions_are_read_as_calls():
    assert distribution_from("log-uniform(.01, 1)") == {"log-uniform": [0.01, 1.0]}
    assert distribution_from("choice(paper,split)") == {"choice": ["paper", "split"]}
    for wrong in ("normal(0,1)", "uniform(1)", "uniform(a,b)"):
        with pytest.raises(ValueError, match="expected"):
            distribution_from(wrong)


def test_a_written_plan_is_read_as_the_same(tmp_path):
    plan = plan_from({**GRID, "draw": {"safety.eta": {"choice": [1, 2]}}, "draws": 3})
    (tmp_path / "study.toml").write_text(plan_text(plan))
    assert read_plan(tmp_path / "study.toml") == plan


def test_a_written_plan_keeps_a_scenario_whose_fields_have_no_value(tmp_path):
    """TOML has no None: a loaded scenario has some, in tables and in lists of tables."""
    whole = load("unicycles").model_dump(mode="json", by_alias=True, exclude={"reading", "seed"})
    plan = plan_from({"scenario": whole})
    (tmp_path / "study.toml").write_text(plan_text(plan))
    again = read_plan(tmp_path / "study.toml")
    assert again.load(again.case(0)) == plan.load(plan.case(0))


def test_a_plan_that_is_no_toml_is_refused_by_its_file(tmp_path):
    file = tmp_path / "study.toml"
    file.write_text("scenario = ")
    with pytest.raises(ScenarioError, match=r"study.toml: not valid TOML"):
        read_plan(file)
    with pytest.raises(ScenarioError, match=r"none.toml: cannot be read"):
        read_plan(tmp_path / "none.toml")
