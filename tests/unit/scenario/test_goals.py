"""Goals in a scenario: what is written is read again, and each mistake is one line."""

import pytest

from phalanx.scenario.load import from_json, load
from phalanx.scenario.model import to_json
from phalanx.swarm.swarm import build_swarm
from tests.unit.scenario.refusals import cases, refusal

# By a goal of an agent in the plane.
MISTAKES = """
[1.0] | .position: expected at least 2 items
[1.0, 2.0, 3.0] | : expected 2 coordinates, as the agents'
["x", 1.0] | .position.0: expected a valid number
[nan, 1.0] | : expected finite numbers
{points=[[1, 2], [1, 3]]} | : expected a field type, one of point, waypoints, path
{type="curve"} | : expected one of point, waypoints, path
{type="path", points=[[1, 2]], speed=1} | .points: expected at least 2 items
{type="path", points=[[1, 2], [1, 2]], speed=1} | : expected points that differ from the one before
{type="path", points=[[1, 2], [1, 3]]} | .speed: expected a value
{type="path", points=[[1, 2], [1, 3]], speed=0} | .speed: expected greater than 0
{type="waypoints", points=[[1, 2], [1, 3]]} | : expected either times or a tolerance
{type="waypoints", points=[[1, 2], [1, 3]], times=[0, 1], tolerance=1} | : expected either times
{type="waypoints", points=[[1, 2], [1, 3]], times=[1]} | : expected a time for each of the 2 points
{type="waypoints", points=[[1, 2], [1, 3]], times=[1, 1]} | : expected times that increase
{type="waypoints", points=[[1, 2], [1, 2, 3]], tolerance=1} | : expected points that are all 2-D or
{type="point", at=[1, 2]} | .at: unknown field (misspelt
"""


@pytest.mark.parametrize(("goal", "said"), cases(MISTAKES))
def test_a_mistaken_goal_is_one_line(goal, said):
    lines = refusal([f"agents.0.goal.0={goal}"], "crossing").splitlines()
    assert any(line.startswith(f"crossing: agents.0.goal.0{said}") for line in lines)


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("goal", [1.0, 2.0], "expected a list with one for each agent, such as [[4.0, 2.0]]"),
        ("goal", {"type": "point"}, "expected a list with one for each agent"),
        ("goal", [[1.0, 2.0]], "expected one for each of the 4 agents"),
        ("slots", [0, 1, 2, 3], "expected goal or slots, not both"),
        ("law", {"type": "pursue"}, "expected none: the law pursue does not steer by a goal"),
    ],
)
def test_goals_that_do_not_fit_their_group_are_one_line(field, value, said):
    (line,) = refusal({f"agents.0.{field}": value}, "crossing").splitlines()
    assert line.startswith(f"crossing: agents.0.goal: {said}")


def test_a_goal_survives_being_written_and_read():
    scenario = load("crossing")
    assert from_json(to_json(scenario)).agents == scenario.agents


def test_a_point_may_be_overridden_by_its_place():
    swarm = build_swarm(load("crossing", ["agents.0.goal.3=[1.0, 2.0]"]))
    assert swarm.goal(3).reference.end().tolist() == [1.0, 2.0]


def test_agents_without_goal_have_none():
    swarm = build_swarm(load("crossing"))
    assert [swarm.has_goal(i) for i in range(5)] == [True] * 4 + [False]
    assert not build_swarm(load("surrounded")).has_goal(0)
