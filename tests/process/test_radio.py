"""Radio over real processes: each fault of a link acts on states, and engines agree to the bit."""

import polars as pl
import pytest

import phalanx
from tests.layers import layered
from tests.process.runs import on_both_engines

pytestmark = pytest.mark.swarm

FEWER = {"duration": 1.5, "agents.0.radio.every": 4}
NETWORKS = {
    "all that netem does": {
        "network.delay": {"time": 0.04, "jitter": 0.03, "distribution": "paretonormal"},
        "network.loss": {"mean": 0.4, "burst": 3.0},
        "network.loss_by_distance": {"none_within": 6.0, "all_beyond": 14.0},
        "network.duplicate": 0.2,
        "network.corrupt": 0.2,
        "network.reorder": {"probability": 0.9, "gap": 2},
        "network.trace": {"t": [0.0, 0.4, 0.7], "delay": [0.0, 0.03, -1.0]},
        "network.rate": {"bits_per_second": 2e5, "limit": 10},
        "network.slot": 0.02,
        "faults": [{"kind": "partition", "at": 0.5, "for": 0.5, "shape": "ring"}],
    },
    "disturbed, in drag": {
        "agents.0.disturbance": {"bound": 0.1, "kind": "adverse"},
        "agents.0.dynamics.drag": 0.5,
        "faults": [{"kind": "lie", "agent": "2", "drift": [0.3, 0.0, 0.0, 0.0], "for": 9.0}],
    },
    "restarted, paused": {
        "faults": [
            {"kind": "restart", "at": 0.3, "for": 0.3, "agents": ["1"]},
            {"kind": "pause", "at": 0.5, "for": 0.4, "agents": ["5"]},
        ]
    },
}


@pytest.mark.parametrize("changes", NETWORKS.values(), ids=NETWORKS)
def test_whatever_happens_to_states_on_their_way_the_trajectory_is_one(changes: dict) -> None:
    scenario = phalanx.load("radio", {**FEWER, **changes})
    runs = on_both_engines(scenario)
    assert runs[0].summary.outcome is not phalanx.Outcome.VIOLATED
    assert runs[0].summary.notes == [], "every fault had an effect"


OTHERS = ("crossing-radio", "warehouse-radio", "guaranteed-radio", "formation3d-radio")


@pytest.mark.parametrize("name", layered(OTHERS, ("guaranteed-radio",)))
def test_other_agents_have_one_trajectory_too(name: str) -> None:
    fewer = {"duration": 1.5, "agents.0.disturbance.kind": "adverse"}
    faults = [{"kind": "partition", "at": 0.5, "for": 0.5, "shape": "ring"}]
    runs = on_both_engines(phalanx.load(name, {**fewer, "faults": faults}))
    assert runs[0].summary.outcome is phalanx.Outcome.GUARANTEED


def test_one_that_was_restarted_stands_until_it_has_heard_its_peers() -> None:
    restart = {"kind": "restart", "at": 1.0, "for": 0.2, "agents": ["1"]}
    changes = {"duration": 2.5, "network.loss": 0.0, "faults": [restart]}
    run = phalanx.run(phalanx.load("radio", changes))
    states = run.states
    speed = (states["1.vx"] ** 2 + states["1.vy"] ** 2).sqrt()
    slowest = speed.filter(states["t"] > 1.2).min()
    assert slowest < 0.7 * speed.filter(states["t"] < 1.0).max()
    ages = run.inputs.filter(agent="1").filter(pl.col("t") >= 1.2)["oldest_input"].to_list()
    assert ages[0] is None
    assert ages[-1] > 0.0
