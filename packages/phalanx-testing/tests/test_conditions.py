"""Faults, networks and starts, as objects and as drawn, make valid scenarios."""

import tomllib

import pytest
from hypothesis import given, settings
from phalanx_testing import fault_tables, faults, faulty, networks, starts
from phalanx_testing.conditions import table_of_scenario
from phalanx_testing.fault_tables import table_of

from phalanx.scenario.declared import KINDS
from phalanx.scenario.load import load, scenario_text
from phalanx.scenario.model import digest

from .crossing import CROSSING

ONE_OF_EACH = [
    fault_tables.partition(["a"], at=1.0, for_=0.5),
    fault_tables.hold(at=1.0, for_=0.5, from_="a", to="b"),
    fault_tables.link(at=1.0, for_=0.5, loss=0.9, of="sample"),
    fault_tables.lie("b", at=1.0, for_=0.5, says="zero"),
    fault_tables.kill("a", at=1.0),
    fault_tables.restart("a", at=1.0, for_=0.5),
    fault_tables.pause(rate=0.5, for_=0.5),
    fault_tables.turn("a", at=1.0),
    fault_tables.hijack("a", at=1.0),
    fault_tables.clock("a", at=1.0, step=0.01),
    fault_tables.sensor("a", at=1.0, for_=0.5, bias={"x": 0.1}),
    fault_tables.actuator("a", at=1.0, for_=0.5),
]


def test_there_is_a_function_for_each_kind_of_fault():
    assert {fault.kind for fault in ONE_OF_EACH} == KINDS
    for fault in ONE_OF_EACH:
        assert faulty(CROSSING, faults=[fault]).faults == (fault,)


def test_faults_are_more_than_those_declared_and_the_command_has_all():
    scenario = faulty("radio", faults=[fault_tables.kill("1", at=2.0)], loss=0.1, seed=3)
    assert [fault.kind for fault in scenario.faults] == ["partition", "kill"]
    command = scenario.reading.command(3)
    assert "--set network.loss=0.1" in command
    assert command.count("kind = ") == 2


def test_faults_are_more_than_those_of_the_overrides_too():
    kill, turn = fault_tables.kill("1", at=2.0), fault_tables.turn("2", at=1.0)
    scenario = faulty("radio", faults=[kill], overrides={"faults": [table_of(turn)]})
    assert [fault.kind for fault in scenario.faults] == ["turn", "kill"]


@pytest.mark.parametrize("name", ["radio", "warehouse", "unicycles", "quadrotors", "swarm2d"])
def test_a_scenario_is_the_same_after_a_file(name):
    scenario = load(name, seed=5)
    again = load(tomllib.loads(scenario_text(table_of_scenario(scenario))))
    assert digest(again) == digest(scenario)


def test_a_wrong_fault_is_refused_where_it_is_made():
    with pytest.raises(ValueError, match="greater than 0"):
        fault_tables.pause("a", at=1.0, for_=-1.0)


@settings(max_examples=15)
@given(networks(), faults(["a", "b"], until=3.0), starts([[-1.5, 0.1], [1.5, 0.0]], spread=0.2))
def test_what_strategies_draw_is_a_valid_scenario(network, drawn, start):
    scenario = faulty(CROSSING, faults=drawn, overrides={"agents.0.start": start}, **network)
    assert len(scenario.faults) == len(drawn)
    assert all(-1.71 < s[0] < 1.71 for s in scenario.agents[0].start)
