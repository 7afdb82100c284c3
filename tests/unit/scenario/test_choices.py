"""Choices of gains, margin, obstacles and laws: what may be given, and what is refused by name."""

import pytest

from phalanx.scenario.load import ScenarioError, load
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
        ("safety.margin=local", "safety.eta: expected no value"),
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


def test_the_integrated_margin_bounds_one_pair():
    with pytest.raises(ScenarioError, match=r"safety\.margin: expected composition = 'pairs'"):
        load("guaranteed", ["safety.composition=lse"])


def test_a_wall_without_a_direction_is_refused():
    with pytest.raises(ScenarioError, match=r"obstacles\.0.*normal: expected a direction"):
        load("pinned", ["obstacles.0.normal=[0.0, 0.0]"])
