"""Swarms as PettingZoo's environments: its own tests, and the bits of a run."""

import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

import phalanx
from phalanx.extend import View

SHORT = {"duration": 0.1}
AHEAD, PUSH = np.array([4.0, 0.0]), np.array([1.5, -0.5])


@dataclass
class Constant:
    """An attack that always applies PUSH."""

    def prepare(self, dynamics: object) -> None:
        pass

    def input(self, view: View) -> np.ndarray:
        return PUSH


@pytest.mark.slow
@pytest.mark.parametrize(
    "acting",
    [
        "both",
        *(pytest.param(a, marks=pytest.mark.nightly) for a in ("attackers", "defenders")),
        pytest.param(["1", "5"], marks=pytest.mark.nightly),
    ],
)
def test_it_passes_pettingzoos_own_tests(acting):
    scenario = phalanx.load("unicycles", SHORT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parallel_api_test(phalanx.parallel_env(scenario, acting=acting), num_cycles=20)
        parallel_seed_test(lambda: phalanx.parallel_env(scenario, acting=acting), num_cycles=20)


@pytest.mark.slow
def test_an_episode_has_the_bits_of_a_run_whose_law_makes_the_same_inputs():
    env = phalanx.parallel_env(phalanx.load("unicycles", SHORT), every=0.03)
    env.reset(seed=4)
    while env.agents:
        *_, infos = env.step(dict.fromkeys(env.agents, PUSH))
    law = {"type": f"{__name__}:Constant"}
    again = phalanx.load("unicycles", {**SHORT, "agents.1.law": law}, seed=4)
    run = phalanx.run(again, engine="in-process")
    assert env.summary.trajectory == run.summary.trajectory
    assert infos["4"]["verdict"] == run.verdict == env.summary.outcome


@pytest.mark.slow
def test_each_sees_what_is_in_its_sight_and_holds_inputs_within_its_own_bounds():
    scenario = phalanx.load("unicycles", {**SHORT, "agents.1.sensing": 5.0})
    env = phalanx.parallel_env(scenario, acting="both")
    seen, _ = env.reset(seed=0)
    x, sight = seen["4"][:15].reshape(5, 3), seen["4"][15:]
    start = phalanx.start(scenario)
    assert (x[3] == start.states["4"]).all()
    for name, own, shown in zip("12345", x, sight, strict=True):
        near = np.linalg.norm(start.states[name][:2] - start.states["4"][:2]) < 4.0
        assert shown or not near
        assert (own == (start.states[name] if shown else 0.0)).all()
    assert 1 < sight.sum() < 5
    assert sight.sum() < seen["1"][15:].sum() == 5
    assert env.action_space("4").high.tolist() == [2.0, 1.0]
    assert env.action_space("1").low.tolist() == [-4.0, -2.0]
    start.end()


CLOSE = {
    "duration": 1.0,
    "agents.0.controller": {"type": "none"},
    "agents.0.start": [[0.0, 0.0, 0.0], [3.0, 0.0, 3.14], [-9.0, 0.0, 0.0]],
    "agents.0.spread": [],
}


@pytest.mark.slow
def test_rewards_sum_to_the_rise_of_the_largest_h_and_an_unsafe_pair_ends_the_episode():
    env = phalanx.parallel_env(phalanx.load("unicycles", CLOSE), acting=["1", "2"], every=0.05)
    _, infos = env.reset(seed=1)
    begun, total, ended = infos["1"]["h"], {"1": 0.0, "2": 0.0}, {}
    while env.agents:
        _, rewards, ended, truncated, infos = env.step(dict.fromkeys("12", AHEAD))
        total = {name: total[name] + rewards[name] for name in total}
    assert ended == {"1": True, "2": True}
    assert not any(truncated.values())
    assert infos["1"]["verdict"] == "violated"
    assert infos["1"]["h"] > 0.0
    assert total["1"] == total["2"] == pytest.approx(begun - infos["1"]["h"])


@pytest.mark.slow
def test_a_pair_that_was_unsafe_between_two_steps_ends_the_episode():
    env = phalanx.parallel_env(phalanx.load("unicycles", CLOSE), acting=["1", "2"], every=0.8)
    _, infos = env.reset(seed=1)
    begun = infos["1"]["h"]
    seen, rewards, ended, _, infos = env.step(dict.fromkeys("12", AHEAD))
    x = seen["1"][:15].reshape(5, 3)
    assert x[0, 0] > x[1, 0] + 1.0, "each has driven through the other"
    violations = {v.pair: v.worst for v in env.summary.violations}
    assert violations == {"1-2": infos["1"]["h"]}
    assert ended == {"1": True, "2": True}
    assert rewards["1"] == begun - infos["1"]["h"]


@pytest.mark.slow
def test_mistakes_are_named():
    scenario = phalanx.load("unicycles", SHORT)
    with pytest.raises(ValueError, match=r"acting: expected attackers, defenders, both, got 'all'"):
        phalanx.parallel_env(scenario, acting="all")
    with pytest.raises(ValueError, match=r"acting: expected some of the agents .*, got \['9'\]"):
        phalanx.parallel_env(scenario, acting=["9"])
    with pytest.raises(ValueError, match="every: expected more than 0 s, got 0"):
        phalanx.parallel_env(scenario, every=0.0)
    env = phalanx.parallel_env(scenario, acting=["4"])
    with pytest.raises(ValueError, match="the episode is over: call reset"):
        env.step({})
    env.reset()
    for action in (None, np.zeros(3), np.array([np.nan, 0.0])):
        with pytest.raises(ValueError, match="actions: expected 2 finite numbers for agent 4"):
            env.step({"4": action})
    env.close()
