"""Obstacles scattered at random: apart, clear of every start, and a function of the seed."""

import numpy as np
import pytest

from phalanx.scenario.load import ScenarioError, from_json, load, to_json
from phalanx.swarm.swarm import build_swarm


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
