"""Choices of gains, margin, obstacles and laws: what may be given, and what is refused by name."""

import pytest

from phalanx.scenario.load import load, read_table
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.safety.class_k import Linear


def test_alpha_may_be_a_number_or_a_table():
    given = ['safety.alpha=[1.5, {type = "power", gain = 2.0, exponent = 3.0}]']
    first, second = load("formation3d", given).safety.class_k
    assert first == Linear(1.5)
    assert (type(second).__name__, second.gain, second.exponent) == ("Power", 2.0, 3.0)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('safety.alpha=[{type = "power", gain = 2.0}]', r"safety.alpha.*exponent"),
        ("safety.composition=both", "safety.composition: expected 'lse' or 'pairs'"),
        ("safety.neighbourhood=-1.0", "safety.neighbourhood"),
        ("agents.1.law.targets={4 = 'nobody'}", "law of 4: targets: expected one of"),
        ("agents.0.law.gains=[1.0]", r"gains: .*needs 2"),
    ],
)
def test_what_is_wrong_is_named(override, message):
    with pytest.raises(ScenarioError, match=message):
        build_swarm(load("formation3d", [override])).law(4)


def test_the_integrated_margin_needs_a_linear_last_gain():
    power = 'safety.alpha=[{type = "power", gain = 2.0, exponent = 3.0}]'
    with pytest.raises(ScenarioError, match=r"safety\.alpha\.0: expected a number"):
        load("guaranteed", [power])
    assert load("guaranteed", [power, "safety.margin=local"]).safety.computes_margin


@pytest.mark.parametrize("margin", ["corrected", "local", "integrated"])
def test_one_row_for_all_pairs_has_the_papers_margin(margin):
    message = r"safety\.margin: expected 'paper', or composition = 'pairs': see docs/retired\.md"
    with pytest.raises(ScenarioError, match=message):
        load("unicycles", [f"safety.margin={margin}", "safety.eta=0"])


def test_without_a_choice_each_pair_has_a_row_of_which_agents_keep_halves():
    table = read_table("unicycles")
    safety = {k: v for k, v in table["safety"].items() if k not in ("composition", "information")}
    found = load({**table, "safety": safety}).safety
    assert (found.composition, found.information) == ("pairs", "split")


def test_halves_are_of_pairs():
    message = r"safety\.information: expected another, or composition = 'pairs': see docs/retired"
    with pytest.raises(ScenarioError, match=message):
        load("unicycles", ["safety.information=split"])
    assert load("unicycles", ["safety.information=split", "safety.control=centralised"])


def test_a_computed_margin_has_no_eta():
    with pytest.raises(ScenarioError, match=r"safety\.eta: expected no value"):
        load("guaranteed", ["safety.eta=1.0"])


def test_a_wall_without_a_direction_is_refused():
    with pytest.raises(ScenarioError, match=r"obstacles\.0.*normal: expected a direction"):
        load("pinned", ["obstacles.0.normal=[0.0, 0.0]"])
