"""Goals in a scenario: what is written is read again, and each mistake is one line."""

import pytest

from phalanx.scenario.load import from_json, load
from phalanx.scenario.model import ScenarioError, to_json
from phalanx.swarm.swarm import build_swarm

POINTS = [[1.0, 2.0], [1.0, 3.0]]
MISTAKES = {
    "too few coordinates": ([1.0], "0.position: expected at least 2 items"),
    "a point of another space": ([1.0, 2.0, 3.0], "0: expected 2 coordinates, as the agents'"),
    "a word": (["x", 1.0], "0.position.0: expected a valid number"),
    "no number": ([float("nan"), 1.0], "0: expected finite numbers"),
    "no type": ({"points": POINTS}, "0: expected a field type, one of point, waypoints, path"),
    "an unknown type": ({"type": "curve"}, "0: expected one of point, waypoints, path"),
    "a path of one point": (
        {"type": "path", "points": POINTS[:1], "speed": 1.0},
        "0.points: expected at least 2 items",
    ),
    "a path that stands": (
        {"type": "path", "points": [POINTS[0]] * 2, "speed": 1.0},
        "0: expected points that differ from the one before",
    ),
    "no speed": ({"type": "path", "points": POINTS}, "0.speed: expected a value"),
    "a path without speed": (
        {"type": "path", "points": POINTS, "speed": 0.0},
        "0.speed: expected greater than 0",
    ),
    "waypoints without times and tolerance": (
        {"type": "waypoints", "points": POINTS},
        "0: expected either times or a tolerance",
    ),
    "waypoints with both": (
        {"type": "waypoints", "points": POINTS, "times": [0.0, 1.0], "tolerance": 1.0},
        "0: expected either times or a tolerance",
    ),
    "too few times": (
        {"type": "waypoints", "points": POINTS, "times": [1.0]},
        "0: expected a time for each of the 2 points",
    ),
    "times that stand": (
        {"type": "waypoints", "points": POINTS, "times": [1.0, 1.0]},
        "0: expected times that increase",
    ),
    "points of two spaces": (
        {"type": "waypoints", "points": [[1.0, 2.0], [1.0, 2.0, 3.0]], "tolerance": 1.0},
        "0: expected points that are all 2-D or all 3-D",
    ),
    "an unknown field": ({"type": "point", "at": [1.0, 2.0]}, "0.at: unknown field (misspelt"),
}


def lines_of(overrides: dict[str, object]) -> list[str]:
    with pytest.raises(ScenarioError) as error:
        load("crossing", overrides)
    return str(error.value).splitlines()


@pytest.mark.parametrize(("goal", "expected"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistaken_goal_is_one_line(goal, expected):
    assert any(
        line.startswith(f"crossing: agents.0.goal.{expected}")
        for line in lines_of({"agents.0.goal.0": goal})
    )


@pytest.mark.parametrize(
    ("field", "value", "expected"),
    [
        ("goal", [1.0, 2.0], "expected a list with one for each agent, such as [[4.0, 2.0]]"),
        ("goal", {"type": "point"}, "expected a list with one for each agent"),
        ("goal", [[1.0, 2.0]], "expected one for each of the 4 agents"),
        ("slots", [0, 1, 2, 3], "expected goal or slots, not both"),
        ("law", {"type": "pursue"}, "expected none: the law pursue does not steer by a goal"),
    ],
)
def test_goals_that_do_not_fit_their_group_are_one_line(field, value, expected):
    (line,) = lines_of({f"agents.0.{field}": value})
    assert line.startswith(f"crossing: agents.0.goal: {expected}")


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
