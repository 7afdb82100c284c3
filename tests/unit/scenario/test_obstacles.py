"""Obstacles of a scenario: polygons, agents that serve as obstacles, and scattered spheres."""

import numpy as np
import pytest

import phalanx
from phalanx.scenario.load import from_json, load
from phalanx.scenario.model import ScenarioError, to_json
from phalanx.swarm.swarm import build_swarm

CORNERS = [[3.0, -2.0], [6.5, -3.0], [3.0, -4.0]]


def test_a_polygon_is_for_agents_in_the_plane():
    with pytest.raises(ScenarioError, match=r"obstacles.0.corners: expected 3 coordinates, as the"):
        load("formation3d", {"scatter": None, "obstacles": [{"corners": CORNERS}]})


def test_a_polygon_is_written_and_read_again():
    scenario = load("unicycles", {"obstacles": [{"corners": CORNERS, "rounding": 0.2}]})
    (polygon,) = from_json(to_json(scenario)).obstacles
    assert polygon == scenario.obstacles[0]
    assert polygon.rounding == 0.2


@pytest.mark.nightly
@pytest.mark.slow
def test_carts_are_proven_safe_from_a_ramp_and_from_a_truck_that_crosses_their_path():
    run = phalanx.run("warehouse", engine="in-process")
    assert run.verdict == "guaranteed"
    ramp = run.scenario.obstacles[2]
    states, carts = run.states, ("cart-1", "cart-2", "cart-3")
    truck = states.select("truck.x", "truck.y").to_numpy()
    assert np.linalg.norm(truck[-1] - truck[0]) > 6.5
    least = run.metrics["least_distance"][-1]
    assert 1.0 <= least < 1.1, "the truck is what came nearest"
    nearest = [ramp.distances(output_points(states, cart)).min() - ramp.clearance for cart in carts]
    assert 0.0 <= min(nearest) < 0.3, "a cart has to go around the ramp"


def output_points(states, cart: str) -> np.ndarray:
    x, y, theta = (states[f"{cart}.{name}"].to_numpy() for name in ("x", "y", "theta"))
    return np.column_stack([x + 0.25 * np.cos(theta), y + 0.25 * np.sin(theta)])


@pytest.mark.parametrize("seed", range(5))
def test_random_obstacles_keep_apart_and_clear_of_every_start(seed):
    scenario = load("formation3d", seed=seed)
    centers = np.array([o.center for o in scenario.obstacles])
    starts = build_swarm(scenario).start().reshape(8, 6)[:, :3]
    between = np.linalg.norm(centers[:, None] - centers[None], axis=2) + 1e9 * np.eye(10)
    assert len(centers) == 10
    assert between.min() >= 10.0
    assert np.linalg.norm(centers[:, None] - starts[None], axis=2).min() >= 25.0


def test_random_obstacles_follow_the_seed_and_are_part_of_the_resolved_scenario():
    one, two = load("formation3d", seed=1), load("formation3d", seed=2)
    assert one.obstacles != two.obstacles
    assert one == load("formation3d", seed=1)
    assert from_json(to_json(one)).obstacles == one.obstacles
    assert one.scatter is None


def test_no_room_for_obstacles_is_an_error_that_names_the_field():
    with pytest.raises(ScenarioError, match="scatter: no room for 10 obstacles"):
        load("formation3d", ["scatter.apart=1000.0"])
