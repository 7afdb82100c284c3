"""Agents that watch each other: liars are convicted, and no agent that held what it announced."""

import pytest

import phalanx
from phalanx.guarantee.verdict import TrustSummary
from tests.layers import layered
from tests.process.runs import on_both_engines

WATCH = {"safety.watch": True, "duration": 1.5}
HONEST = {
    "losses and delays": {"network.loss": {"mean": 0.3, "burst": 3.0}, "network.delay": 0.013},
    "order and copies": {
        "network.delay": {"low": 0.0, "high": 0.05},
        "network.duplicate": 0.3,
        "network.corrupt": 0.2,
    },
    "adverse disturbances": {
        "agents.0.disturbance.kind": "adverse",
        "agents.1.disturbance.kind": "adverse",
    },
    "latency": {"time.latency": 0.004},
    "come and go": {"safety.neighbourhood": 4.7},
}
SHORT = {
    "two samples at one instant, as a clock steps": {
        "agents.0.clock": {"period": 0.125},
        "duration": 0.7,
        "faults": [{"kind": "clock", "at": 0.5, "agents": ["1"], "step": -0.2}],
    },
    "clocks that step at random": {
        "agents.0.clock": {"period": 0.01},
        "agents.0.disturbance.bound": 0.0,
        "duration": 0.05,
        "seed": 39,
        "faults": [{"kind": "clock", "rate": 5.0, "step": -0.01}],
    },
}
"""Clock faults after which an agent samples twice within one float64, or a few."""
LIES = {
    "opposite": {"says": "opposite"},
    "zero": {"says": "zero"},
    "equivocation": {"equivocate": True},
}


def trust(scenario: str, **changes: object) -> TrustSummary:
    run = phalanx.run(phalanx.load(scenario, {**WATCH, **changes}), engine="in-process")
    assert run.summary.trust is not None
    return run.summary.trust


CALM = HONEST | SHORT


@pytest.mark.parametrize("name", layered(CALM, CALM.keys() - {"latency", "order and copies"}))
def test_no_honest_agent_is_convicted(name):
    record = trust("unicycles", **CALM[name])
    assert (record.betrayals, record.convictions) == ({}, [])


@pytest.mark.parametrize("name", LIES)
@pytest.mark.parametrize("network", layered(("no losses", "losses and delays"), ("no losses",)))
def test_a_liar_is_convicted_by_all_that_hear_it(name, network):
    lie = {"kind": "lie", "agent": "2", "at": 0.5, "for": 5.0, **LIES[name]}
    record = trust("unicycles", faults=[lie], **HONEST.get(network, {}))
    assert {conviction.of for conviction in record.convictions} == {"2"}
    assert {conviction.by for conviction in record.convictions} == {"1", "3"}
    assert record.false == 0
    assert 0.5 <= record.betrayals["2"] < 0.52
    for conviction in record.convictions:
        assert conviction.after == conviction.t - record.betrayals["2"] > 0.0


def test_a_hijack_is_an_event_of_both_that_see_it_and_of_one_trajectory():
    faults = [{"kind": "hijack", "at": 0.5, "agents": ["2"]}]
    scenario = phalanx.load("unicycles", {**WATCH, "faults": faults})
    run, _ = on_both_engines(scenario)
    texts = [text for text in run.events["text"] if "convicts agent 2" in text]
    assert [text.split()[1] for text in texts] in (["1", "3"], ["3", "1"])
    unwatched = phalanx.load("unicycles", {**WATCH, "safety.watch": False, "faults": faults})
    calm = phalanx.run(unwatched, engine="in-process").summary
    assert calm.trust is None
    assert calm.trajectory == run.summary.trajectory


ACTUATORS = {
    "stuck": {"faults": [{"kind": "actuator", "at": 0.0, "for": 0.3, "agents": ["2"]}]},
    "late": {"network.actuation": {"delay": 0.004}},
}


@pytest.mark.parametrize("name", ACTUATORS)
def test_who_holds_another_input_than_it_announced_is_not_convicted_falsely(name):
    """It did not mean to: its actuator is stuck, or late."""
    record = trust("unicycles", duration=0.3, **ACTUATORS[name])
    assert {"2"} <= {each.of for each in record.convictions} <= set(record.betrayals)
    assert record.false == 0
    count = len({each.by for each in record.convictions})
    assert dict(record.rows)["convictions"] == f"{len(record.convictions)} by {count} agents"
