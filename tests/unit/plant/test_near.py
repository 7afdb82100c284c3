"""Pairs that are left out of the truth: none that could count, wherever agents go."""

import numpy as np
import pytest

from phalanx.plant.world import near
from phalanx.plant.world.motion import Motion
from phalanx.plant.world.near import NearPairs
from phalanx.swarm.swarm import Swarm
from phalanx.theory.safety.obstacles import Sphere, Wall
from tests.unit.swarms import swarm_of_scenario

LARGE = ("agents.0.count=28", "agents.1.count=4")


def both(swarm: Swarm, monkeypatch: pytest.MonkeyPatch) -> tuple[NearPairs, NearPairs]:
    """One that looks up who is near, and one that takes every pair."""
    motion = Motion(swarm.members, 1)
    monkeypatch.setattr(near, "_FEW", 0)
    looking = NearPairs(swarm, motion)
    monkeypatch.setattr(near, "_FEW", 1_000_000)
    return looking, NearPairs(swarm, motion)


@pytest.mark.parametrize("name", ["swarm", "swarm2d", "formation3d"])
def test_what_is_left_out_changes_neither_h_tot_nor_who_is_unsafe(name, monkeypatch):
    swarm = swarm_of_scenario(name, *(LARGE if name.startswith("swarm") else ()))
    looking, taking_all = both(swarm, monkeypatch)
    walk = np.random.default_rng(0)
    x, fewest = swarm.start(), np.inf
    for step in range(300):
        # Now and then somebody is thrown far, as by a restart from another state.
        size = 3.0 if step % 50 == 49 else 0.05
        x = x + size * walk.standard_normal(x.shape)
        two = np.stack([x, x + 0.01])
        pairs, h, h_tot = looking(two)
        every, h_all, h_tot_all = taking_all(two)
        assert sorted(every) == list(range(len(swarm.safe_set.pairs)))
        assert (h_tot == h_tot_all).all() or h_tot == pytest.approx(h_tot_all, rel=1e-15)
        order = np.argsort(every)
        assert (h == h_all[:, order[pairs]]).all()
        left_out = np.ones(len(every), dtype=bool)
        left_out[order[pairs]] = False
        if left_out.any():
            assert h_all[:, left_out].max() < min(0.0, h.max(axis=1).min())
        fewest = min(fewest, len(pairs))
    assert fewest < 0.5 * len(swarm.safe_set.pairs)


def test_a_function_that_does_not_say_how_far_it_reaches_has_all_its_pairs(monkeypatch):
    oval = 'safety.function={ type = "tests.unit.theory.users_own:Oval" }'
    swarm = swarm_of_scenario("swarm2d", *LARGE, oval)
    looking, _ = both(swarm, monkeypatch)
    assert len(looking(swarm.start()[None])[0]) == len(swarm.safe_set.pairs)


def test_pairs_are_numbered_as_the_safe_set_has_them(monkeypatch):
    swarm = swarm_of_scenario("formation3d")
    _, taking_all = both(swarm, monkeypatch)
    which, h, _ = taking_all(swarm.start()[None])
    x = swarm.start().reshape(8, 6)[:, :3]
    for number, value in zip(which.tolist(), h[0], strict=True):
        pair = swarm.safe_set.pairs[number]
        obstacle = pair.obstacle is not None and swarm.scenario.obstacles[pair.obstacle]
        there = np.array(obstacle.center) if obstacle else x[pair.b]
        keep_out = obstacle.clearance if obstacle else 5.0
        assert value == pytest.approx(keep_out**2 - np.sum((x[pair.a] - there) ** 2))


@pytest.mark.parametrize("level", [0.0, -1.0, -50.0])
@pytest.mark.parametrize("obstacle", [Sphere((0.0, 0.0), 0.5), Wall((0.0, 2.0), 1.0, 0.5)])
def test_beyond_its_reach_an_obstacles_intrusion_is_below_the_level(obstacle, level):
    points = np.random.default_rng(1).uniform(-100.0, 100.0, (2000, 2))
    beyond = obstacle.distances(points) > obstacle.reach(level)
    h = np.array([float(obstacle.intrusion(p)) for p in points])
    assert beyond.any()
    assert (h[beyond] < level).all()
    assert (h[~beyond] >= level - 1e-6).all()
