"""Scenario files that load, and what --set makes of them."""

import tomllib

import pytest

from phalanx.network.delay import UniformDelay
from phalanx.scenario.load import (
    field_and_value,
    from_json,
    inline,
    load,
    read_table,
    scenario_text,
    set_field,
    value_from,
)
from phalanx.scenario.model import ScenarioError, digest, to_json
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.margins.margin import MarginConstants
from tests.unit.scenario.refusals import cases
from tests.unit.swarms import rows_of_scenario


def test_unicycles_is_simulation_1_of_the_paper():
    scenario = load("unicycles")
    rows = rows_of_scenario("unicycles")
    swarm = rows.swarm
    assert swarm.names == ("1", "2", "3", "4", "5")
    assert swarm.normal == (0, 1, 2)
    assert rows.chain.relative_degree == 1
    assert len(swarm.safe_set.pairs) == 3 + 3 * 2 + 3 * 3
    assert [rows.margin(i).eta for i in range(5)] == [8.0566] * 5
    assert scenario.safety.information == "paper"


def test_agents_start_within_their_spread_of_their_slot():
    scenario = load("unicycles")
    swarm = build_swarm(scenario)
    assert scenario.formation is not None
    for i, (_, group, index) in enumerate(scenario.roster()):
        x = swarm.start()[swarm.safe_set.parts[i]]
        slot = scenario.formation.goal(group.slots[index], 0.0).position
        assert abs(x[:2] - slot).max() <= 0.2
        assert abs(x[2]) <= 0.3


def test_another_seed_starts_elsewhere_and_the_same_seed_at_the_same_place():
    starts = {seed: build_swarm(load("unicycles", seed=seed)).start() for seed in (0, 1)}
    assert (starts[0] != starts[1]).any()
    assert (starts[0] == build_swarm(load("unicycles", seed=0)).start()).all()


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["network.delay={ low = 0.001, high = 0.02 }", "network.loss=0.25"],
        ["safety.eta={c_f=1,c_g=2,c_alpha=3,c_gamma=4,c_h=5,u_max=6,mu=7}"],
        ['network.links=[{ from = "1", to = "*", loss = 1.0 }]'],
    ],
)
def test_json_round_trip_keeps_the_scenario_and_its_digest(overrides):
    scenario = load("unicycles", overrides)
    again = from_json(to_json(scenario))
    assert again == scenario
    assert digest(again) == digest(scenario)
    assert to_json(again) == to_json(scenario)


def test_scenarios_that_differ_anywhere_have_different_digests():
    variants = [[], ["safety.rho=5.5"], ["network.loss=0.1"], ["agents.1.law.gain=5.1"]]
    assert len({digest(load("unicycles", v)) for v in variants}) == len(variants)
    assert digest(load("unicycles", seed=1)) != digest(load("unicycles", seed=2))


def test_a_recorded_scenario_that_is_not_one_is_refused():
    for text in ('{"name": "x"}', '{"name": "x", "agents": 3, "duration": -1}', "[]", "{"):
        with pytest.raises(ScenarioError, match=r"^recorded scenario: \w+: [^\n]*$") as refused:
            from_json(text)
        assert "pydantic" not in str(refused.value)


def test_set_reaches_values_tables_lists_and_makes_missing_tables():
    scenario = load(
        "unicycles",
        [
            "duration=3.5",
            "network.loss=0.3",
            "network.delay.low=0.001",
            "network.delay.high=0.002",
            "agents.1.clock.period=0.02",
            "obstacles.0.center.1=-9.5",
            "safety.alpha.0=3.0",
            "formation.path=[[0.0, 0.0], [1.0, 1.0]]",
        ],
    )
    assert scenario.duration == 3.5
    assert scenario.network.loss == 0.3
    assert scenario.network.delay == UniformDelay(low=0.001, high=0.002)
    assert scenario.agents[1].clock.period == 0.02
    assert scenario.agents[0].clock.period == 0.01
    assert scenario.obstacles[0].center == (14.0, -9.5)
    assert scenario.safety.alpha == (3.0,)
    assert scenario.formation is not None
    assert len(scenario.formation.path) == 2


def test_set_takes_a_bare_word_as_a_string_and_the_last_of_several_wins():
    scenario = load("unicycles", ["safety.information=paper", "safety.information=unknown"])
    assert scenario.safety.information == "unknown"


def test_set_takes_toml_values():
    table = tomllib.loads("a = 1")
    for override in [
        "b=true",
        "c=[1, 2]",
        'd="x=y"',
        "e.f={ g = 1.5 }",
        "h=1979-05-27",
        "i=",
        "j=.5",
    ]:
        set_field(table, *field_and_value(override))
    assert table["b"] is True
    assert table["c"] == [1, 2]
    assert table["d"] == "x=y"
    assert table["e"] == {"f": {"g": 1.5}}
    assert table["i"] == ""
    assert table["j"] == 0.5


@pytest.mark.parametrize(
    "text", ["drone \U0001f681", "é", 'a "b" \\', "\x7f", "\x00\n\t", "\u2028"]
)
def test_every_text_is_read_again_from_its_toml(text):
    table = {"value": text, "inside": {text: [text]}}
    assert tomllib.loads(scenario_text(table)) == table
    assert value_from(inline(text)) == text


def test_no_command_repeats_a_scenario_that_is_a_table():
    assert load("unicycles").reading.command(0) == "phalanx run unicycles --seed 0"
    assert load(read_table("unicycles"), {"duration": 1.0}).reading is None


def test_set_can_turn_the_margin_into_constants_and_back():
    eta = "safety.eta={c_f=1,c_g=2,c_alpha=3,c_gamma=4,c_h=5,u_max=6,mu=7}"
    rows = rows_of_scenario("unicycles", eta)
    assert isinstance(rows.swarm.safety.eta, MarginConstants)
    by_hand = (1 + 2 * 6 + 3 + 4) * 7 * 0.012 + 5 * 5 * 1.73
    assert rows.margin(0).eta == pytest.approx(by_hand)
    assert rows_of_scenario("unicycles", eta, "safety.eta=0").margin(0).eta == 0.0


def test_the_seed_option_outranks_set():
    assert load("unicycles", ["seed=4"], seed=7).seed == 7


WRONG = """
network.loss | network.loss: expected path.to.field=value
=3 | expected path.to.field
a..b=3 | a..b: expected path.to.field
agents.7.role=normal | index from 0 to 1, got '7'
agents.-1.role=normal | index from 0 to 1, got '-1'
agents.first.role=normal | index from 0 to 1, got 'first'
agents.².role=normal | index from 0 to 1, got '²'
safety.alpha.3=1.0 | index from 0 to 0, got '3'
duration.x=3 | duration is a value, not a table
network.loss=often | network.loss: expected a valid number, got 'often'
network.delay={low='0.001', high=0.02} | network.delay.low: expected a valid number, got '0.001'
"""


@pytest.mark.parametrize(("override", "message"), cases(WRONG))
def test_a_wrong_set_says_what_was_expected_and_got(override, message):
    with pytest.raises(ScenarioError) as error:
        load("unicycles", [override])
    assert message in str(error.value)


def test_links_take_the_last_override_that_matches():
    links = """network.links=[
        { from = "1", loss = 0.1 },
        { to = "2", loss = 0.2 },
        { from = "3", to = "1", loss = 0.3, delay = 0.01 },
    ]""".replace("\n", "")
    links_of = load("unicycles", [links, "network.loss=0.5"]).links()
    expected = {("1", "3"): 0.1, ("1", "2"): 0.2, ("3", "2"): 0.2, ("3", "1"): 0.3, ("2", "1"): 0.5}
    assert {link: links_of.model(*link).loss for link in expected} == expected
    assert links_of.model("3", "1").described("delay") == "10 ms"
