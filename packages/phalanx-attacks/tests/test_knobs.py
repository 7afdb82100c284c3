"""Knobs: every point of the cube is a scenario, and within its bounds."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phalanx_attacks.knobs import Point, preset, separated, space_of

from phalanx.scenario.load import load, read_table
from phalanx.scenario.model import ScenarioError

UNIT = st.floats(0.0, 1.0)
BOX = [[-2.0, 10.0], [-6.0, 6.0], [1.0, 1.0]]


def guaranteed(**attack):
    return {**read_table("guaranteed"), "attack": attack}


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(st.data())
def test_every_point_is_a_valid_scenario_within_its_bounds(data):
    gain = {"agents.1.law.gain": {"log-uniform": [1.0, 25.0]}}
    budget = {"most": 2, "kinds": ["lie", "loss", "hold", "partition", "clock", "sensor", "kill"]}
    space = space_of(guaranteed(starts={"4": BOX}, vary=gain, scripts={"5": 3}, faults=budget))
    numbers = data.draw(st.tuples(*[UNIT] * space.numbers))
    choices = data.draw(st.tuples(*[st.integers(0, n - 1) for n in space.choices]))
    scenario = load(space.table, space.overrides(Point(numbers, choices)))
    by_name = {name: group for group in scenario.agents for name in group.names}
    (start,) = by_name["4"].start
    assert all(low <= value <= high for value, (low, high) in zip(start, BOX, strict=True))
    assert 1.0 <= by_name["4"].law["gain"] <= 25.0
    assert len(by_name["5"].law["inputs"]) == 3
    assert len(scenario.faults) == sum(kind > 0 for kind in choices[::2])
    assert all(fault.at < scenario.duration for fault in scenario.faults)
    assert by_name["1"].names == ("1", "2", "3")


@pytest.mark.parametrize("speed", [1.0, 1.256, 2.007])
@pytest.mark.parametrize("number", [0.0, 0.3, 1.0])
def test_a_scripted_input_at_a_face_of_u_is_in_u(speed, number):
    table = guaranteed(scripts={"5": 1})
    for group in table["agents"]:
        group["dynamics"] = {**group["dynamics"], "speed": speed}
    space = space_of(table)
    scenario = load(space.table, space.overrides(Point((number,) * space.numbers, ())))
    (u,) = scenario.agents[-1].law["inputs"]
    assert number != 0.3 or [float(f"{value:.3g}") for value in u] == u, "inside of U it is short"


def test_a_choice_takes_each_of_its_values_and_one_value_needs_no_knob():
    choices = {"duration": [2.0], "safety.eta": [0.1, 0.2], "safety.rho": [1.0, 2.0, 3.0]}
    space = space_of(guaranteed(vary={path: {"choice": of} for path, of in choices.items()}))
    assert (space.numbers, space.choices) == (0, (2, 3))
    chosen = space.overrides(Point((), (1, 2)))
    assert chosen == {"duration": 2.0, "safety.eta": 0.2, "safety.rho": 3.0}


def test_agents_that_get_a_group_of_their_own_keep_slot_and_run():
    table = read_table("guaranteed")
    whole, parts = load(table), load(separated(table, load(table), {"5"}))
    assert [group.names for group in parts.agents] == [("1", "2", "3"), ("4",), ("5",)]
    assert [group.slots for group in parts.agents][1:] == [(2,), (3,)]
    assert [group.spread for group in parts.agents][1] == whole.agents[1].spread


@pytest.mark.parametrize("name", ["guaranteed", "unicycles", "swarm2d", "surrounded", "quadrotors"])
@pytest.mark.parametrize("kind", ["within", "beyond"])
def test_a_preset_fits_any_scenario(name, kind):
    table = read_table(name)
    table["attack"] = preset(kind, load(table))
    space = space_of(table)
    half = Point((0.5,) * space.numbers, (1,) * len(space.choices))
    assert load(space.table, space.overrides(half)).agents


def test_a_start_of_an_attack_turns_a_robot_but_tilts_no_quadrotor():
    (captured,) = preset("within", load("quadrotors"))["starts"].values()
    assert captured[-2:] == [[0.0, 0.0], [0.0, 0.0]]
    cart = preset("within", load("warehouse"))["starts"]["runaway"]
    assert cart[2] == [-math.pi, math.pi]


def test_a_start_of_an_attack_is_within_5_m_of_the_scenarios():
    scenario = load("one-on-one")
    (adversary,) = [group for group in scenario.agents if group.role == "adversary"]
    (box,) = preset("within", scenario)["starts"].values()
    for (low, high), at in zip(box[:2], adversary.start[0][:2], strict=True):
        assert (low, high) == pytest.approx((at - 5.0, at + 5.0), abs=0.011)


def test_a_fault_is_one_of_all_that_its_numbers_can_choose():
    """Each kind of lie can be drawn, and a fault lasts no longer than the budget allows."""
    budget = {"most": 1, "kinds": ["lie"], "longest": 2.0}
    space = space_of(guaranteed(faults=budget))
    lies = set()
    for strength in np.linspace(0.0, 1.0, 11).tolist():
        overrides = space.overrides(Point((0.5, 1.0, strength), (1, 0)))
        (fault,) = load(space.table, overrides).faults
        assert fault.lasts == 2.0
        lies.add((fault.says, fault.equivocate, fault.replay, fault.silent))
    assert len(lies) == 5
    assert space.overrides(Point((0.5, 1.0, 0.5), (0, 0))) == {}


def test_a_sensor_is_off_by_at_most_a_metre_to_either_side():
    space = space_of(guaranteed(faults={"most": 1, "kinds": ["sensor"]}))
    off = []
    for strength in (0.0, 0.5, 1.0):
        (fault,) = space.overrides(Point((0.5, 1.0, strength), (1, 0)))["faults"]
        off += fault["bias"].values()
    assert off == [-1.0, 0.0, 1.0]


def test_within_changes_nothing_that_voids_a_guarantee():
    found = preset("within", load("unicycles"))
    assert set(found["faults"]["kinds"]) == {"lie", "loss", "hold", "partition"}
    assert found["faults"]["most"] == 1
    assert {path.split(".")[2] for path in found["vary"]} == {"law", "disturbance"}
    assert "faults" not in preset("within", load("guaranteed"))  # its rows use no received input


def test_a_preset_varies_the_gains_of_adversaries_where_others_have_declared_starts():
    """An agent with a declared start gets a group of its own, before the adversaries'."""
    table = {**read_table("unicycles"), "attack": {"starts": {"1": BOX}}}
    added = preset("within", load(table))
    table["attack"] = {**added, "starts": {**added["starts"], "1": BOX}}
    agents = space_of(table).table["agents"]
    varied = {int(path.split(".")[1]) for path in added["vary"] if ".law." in path}
    assert {name for place in varied for name in agents[place]["names"]} == {"4", "5"}


@pytest.mark.parametrize(
    ("attack", "expected"),
    [
        ({}, "attack: expected knobs"),
        ({"vary": {"safety.eta": {"choice": [0.0]}}}, "attack: expected knobs"),
        ({"starts": {"4": [[0.0, 1.0]]}}, "attack.starts.4: expected 3 intervals"),
        ({"starts": {"4": [[1.0, 0.0]] * 3}}, "attack.starts.4.0: expected the least value first"),
        ({"scripts": {"1": 3}}, "attack.scripts: expected an agent's name, one of ['4', '5']"),
        ({"faults": {"most": 1, "kinds": ["magic"]}}, "attack.faults.kinds.0: expected"),
    ],
)
def test_a_mistake_in_the_table_is_named(attack, expected):
    with pytest.raises(ScenarioError) as raised:
        space_of(guaranteed(**attack))
    assert expected in str(raised.value)
