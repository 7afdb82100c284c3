"""Groups of a count, and the flows that they start in: names, places, goals, all from the seed."""

import itertools

import numpy as np
import pytest

from phalanx.scenario.load import from_json, load, validate
from phalanx.scenario.model import Scenario, ScenarioError, to_json
from phalanx.scenario.placement import Flow
from phalanx.theory.laws.goals import Sight

SMALL = {"agents.0.count": 7, "agents.1.count": 1}


def starts(scenario: Scenario) -> np.ndarray:
    """Return every agent's start, shape (N, axes)."""
    return np.array([g.start[place][: g.axes] for _, g, place in scenario.roster()])


def centers(scenario: Scenario) -> np.ndarray:
    """Return the centers of the obstacles, shape (o, axes)."""
    return np.array([o.center for o in scenario.obstacles])


@pytest.mark.parametrize("name", ["swarm", "swarm2d"])
@pytest.mark.parametrize("seed", range(3))
def test_agents_and_obstacles_start_in_the_box_and_apart(name, seed):
    scenario = load(name, {"agents.0.count": 56, "agents.1.count": 8}, seed=seed)
    positions = np.vstack([starts(scenario), centers(scenario)])
    assert len(positions) == 64 + 8
    between = np.linalg.norm(positions[:, None] - positions[None], axis=2) + 1e9 * np.eye(
        len(positions)
    )
    assert between.min() >= scenario.flows.apart
    half = scenario.flows.side(64, positions.shape[1]) / 2
    assert 0.8 * half < np.abs(positions).max() <= half


@pytest.mark.parametrize(("name", "axes"), [("swarm", 3), ("swarm2d", 2)])
def test_an_agent_has_as_many_neighbours_in_a_large_swarm_as_in_a_small_one(name, axes):
    def neighbours(agents: int) -> float:
        places = starts(load(name, {"agents.0.count": agents - 8, "agents.1.count": 8}))
        inside = np.abs(places).max(axis=1) < np.abs(places).max() - 1.5 * load(name).flows.apart
        apart = np.linalg.norm(places[inside][:, None] - places[None], axis=2)
        return (apart < 1.5 * load(name).flows.apart).sum() / inside.sum()

    assert neighbours(256) == pytest.approx(neighbours(128), rel=0.35)
    assert load(name).flows.side(256, axes) ** axes == pytest.approx(
        256 * load(name).flows.room, rel=1e-4
    )


def test_counted_agents_are_numbered_where_no_agent_has_the_number():
    table = {"agents.1.names": ["1", "a", "4"], "agents.1.count": None, "agents.0.count": 4}
    names = [name for name, _, _ in load("swarm", table).roster()]
    assert names == ["2", "3", "5", "6", "1", "a", "4"]


def test_a_resolved_scenario_is_the_same_when_it_is_read_again():
    scenario = load("swarm", SMALL)
    assert from_json(to_json(scenario)) == scenario
    assert validate(scenario.model_dump(by_alias=True), "again") == scenario
    assert all(group.count is None and group.start for group in scenario.agents)


def test_places_follow_the_seed():
    assert load("swarm", SMALL, seed=1) == load("swarm", SMALL, seed=1)
    assert (starts(load("swarm", SMALL, seed=1)) != starts(load("swarm", SMALL, seed=2))).all()


def test_every_flow_moves_as_a_whole_along_its_axis():
    flows, start = load("swarm", SMALL).flows, np.array([1.0, 2.0, 3.0])
    sight = Sight(4.0, "1", lambda _: None)
    goals = [Flow(flows, i, start).goal(sight) for i in range(12)]
    directions = [tuple((goal.velocity / flows.speed).tolist()) for goal in goals]
    assert len(set(directions)) == 6
    assert directions[:6] == directions[6:]
    for goal in goals:
        assert (goal.position == start + 4.0 * goal.velocity).all()
        assert not goal.acceleration.any()
    faces = [d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if np.abs(d).sum() == 1.0]
    assert set(directions) == set(faces)


@pytest.mark.timeout(20)
def test_so_many_agents_that_naming_them_takes_long_are_refused_at_once():
    with pytest.raises(ScenarioError, match="expected at most 256 agents, got 100002"):
        load("swarm", {"agents.0.count": 100_000})


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"agents.0.count": 0}, "agents.0.count: expected greater than or equal to 1, got 0"),
        ({"agents.0.count": "many"}, "agents.0.count: expected a valid integer, got 'many'"),
        ({"agents.0.names": ["a"]}, "agents.0: expected names, or a count and no names, got 'both"),
        ({"agents.0.count": None}, "agents.0: expected names, or a count and no names, got 'neit"),
        ({"agents.0.count": 300}, "agents: expected at most 256 agents, got 302"),
        ({"agents.0.start": [[0.0] * 6]}, "agents.0.start: expected one for each of the 14 agents"),
        ({"flows.room": -1.0}, "flows.room: expected greater than 0, got -1.0"),
        ({"flows.room": "9.0"}, "flows.room: expected a valid number, got '9.0'"),
        ({"flows.apart": 50.0}, "flows: no room for 18 agents and obstacles 50 m apart; found 1: "),
        (
            {"agents.1.dynamics.dimension": 2},
            "agents.1.dynamics: expected 3 axes, as the group before it has in [flows], got 2",
        ),
    ],
)
def test_a_mistake_is_an_error_that_names_field_and_fix(overrides, message):
    with pytest.raises(ScenarioError) as error:
        load("swarm", overrides)
    assert message in str(error.value)
