"""Agents that watch each other: liars are convicted, and no agent that held what it announced."""

import pytest

import phalanx
from phalanx.guarantee.verdict import TrustSummary
from tests.layers import layered

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
LIES = {
    "opposite": {"says": "opposite"},
    "zero": {"says": "zero"},
    "equivocation": {"equivocate": True},
}


def trust(scenario: str, **changes: object) -> TrustSummary:
    run = phalanx.run(phalanx.load(scenario, {**WATCH, **changes}), engine="in-process")
    assert run.summary.trust is not None
    return run.summary.trust


@pytest.mark.parametrize("name", layered(HONEST, HONEST.keys() - {"latency", "order and copies"}))
def test_no_honest_agent_is_convicted(name):
    found = trust("unicycles", **HONEST[name])
    assert (found.betrayals, found.convictions) == ({}, [])


@pytest.mark.parametrize("name", LIES)
@pytest.mark.parametrize("network", layered(("no losses", "losses and delays"), ("no losses",)))
def test_a_liar_is_convicted_by_all_that_hear_it(name, network):
    lie = {"kind": "lie", "agent": "2", "at": 0.5, "for": 5.0, **LIES[name]}
    found = trust("unicycles", faults=[lie], **HONEST.get(network, {}))
    assert {each.of for each in found.convictions} == {"2"}
    assert {each.by for each in found.convictions} == {"1", "3"}
    assert found.false == 0
    assert 0.5 <= found.betrayals["2"] < 0.52
    for each in found.convictions:
        assert each.after == each.t - found.betrayals["2"] > 0.0


def test_a_hijack_is_an_event_of_both_that_see_it_and_of_one_trajectory():
    faults = [{"kind": "hijack", "at": 0.5, "agents": ["2"]}]
    scenario = phalanx.load("unicycles", {**WATCH, "faults": faults})
    runs = [phalanx.run(scenario, engine=engine) for engine in ("in-process", "processes")]
    assert runs[0].summary.trust == runs[1].summary.trust
    assert runs[0].summary.trajectory == runs[1].summary.trajectory
    texts = [text for text in runs[0].events["text"] if "convicts agent 2" in text]
    assert [text.split()[1] for text in texts] in (["1", "3"], ["3", "1"])
    unwatched = phalanx.load("unicycles", {**WATCH, "safety.watch": False, "faults": faults})
    calm = phalanx.run(unwatched, engine="in-process").summary
    assert calm.trust is None
    assert calm.trajectory == runs[0].summary.trajectory


def test_a_stuck_actuator_is_convicted_too_though_it_did_not_mean_to():
    stuck = {"kind": "actuator", "at": 0.5, "for": 0.5, "agents": ["2"]}
    found = trust("unicycles", faults=[stuck])
    assert {each.of for each in found.convictions} <= {"2"}


EQUIVOCATIONS = {
    "another input to every peer": {"equivocate": True},
    "a lie to one, the truth to the other": {"says": "zero", "to": ["1"]},
}


BAD_NETWORKS = [
    pytest.param(name, marks=() if name == "losses and delays" else pytest.mark.nightly)
    for name in HONEST
    if name != "come and go"
]


@pytest.mark.parametrize("name", EQUIVOCATIONS)
@pytest.mark.parametrize(
    "network", [pytest.param("no losses", marks=pytest.mark.nightly), *BAD_NETWORKS]
)
def test_who_signs_two_broadcasts_of_one_number_is_convicted_by_all(name, network):
    lie = {"kind": "lie", "agent": "2", "at": 0.5, "for": 5.0, **EQUIVOCATIONS[name]}
    changes = {"safety.evidence": True, "faults": [lie], **HONEST.get(network, {})}
    found = trust("unicycles", **changes)
    proven = [each for each in found.convictions if each.number is not None]
    assert {(each.by, each.of) for each in proven} == {("1", "2"), ("3", "2")}
    assert found.false == 0
    for each in proven:
        assert each.after == each.t - found.betrayals["2"] > 0.0


@pytest.mark.parametrize("name", layered(HONEST, ("losses and delays",)))
def test_evidence_convicts_no_honest_agent_and_changes_no_input(name):
    found = trust("unicycles", **{"safety.evidence": True}, **HONEST[name])
    assert (found.betrayals, found.convictions) == ({}, [])


def test_a_lie_of_the_same_words_to_all_is_no_equivocation():
    lie = {"kind": "lie", "agent": "2", "at": 0.5, "for": 5.0, "says": "zero"}
    found = trust("unicycles", **{"safety.evidence": True}, faults=[lie])
    assert found.convictions
    assert [each.number for each in found.convictions] == [None] * len(found.convictions)


def test_evidence_ends_earned_trust_alike_in_both_engines():
    """Halves are only split in 'crossing', whose pairs come near."""
    lie = {"kind": "lie", "agent": "east", "at": 0.2, "for": 9.0, "says": "zero", "to": ["north"]}
    changes = {
        "network.loss": 0.0, "network.delay": 0.0, "duration": 1.0, "faults": [lie],
        "safety.information": "earned", "safety.evidence": True,
    }  # fmt: skip
    scenario = phalanx.load("crossing", changes)
    runs = [phalanx.run(scenario, engine=engine) for engine in ("in-process", "processes")]
    assert runs[0].summary.trust == runs[1].summary.trust
    assert runs[0].summary.trajectory == runs[1].summary.trajectory
    assert runs[0].summary.trust is not None
    assert {c.of for c in runs[0].summary.trust.convictions if c.number} == {"east"}


def test_an_audit_convicts_in_both_engines_and_ends_earned_trust():
    """An attack that is announced as it is: the motion check finds nothing."""
    changes = {
        "network.loss": 0.0, "network.delay": 0.0, "duration": 1.0,
        "faults": [{"kind": "turn", "at": 0.2, "agents": ["east"]}],
        "safety.information": "earned", "safety.evidence": True, "safety.audit": True,
    }  # fmt: skip
    scenario = phalanx.load("crossing", changes)
    runs = [phalanx.run(scenario, engine=engine) for engine in ("in-process", "processes")]
    assert runs[0].summary.trust == runs[1].summary.trust
    assert runs[0].summary.trajectory == runs[1].summary.trajectory
    assert runs[0].summary.trust is not None
    convictions = runs[0].summary.trust.convictions
    assert {(each.of, each.proof) for each in convictions} == {("east", "replay")}
    assert runs[0].summary.trust.false == 0


def test_signed_broadcasts_change_no_trajectory_in_real_processes():
    scenario = phalanx.load("unicycles", {"duration": 0.4})
    evidence = phalanx.load("unicycles", {"duration": 0.4, "safety.evidence": True})
    calm = phalanx.run(scenario, engine="in-process").summary
    signed = phalanx.run(evidence, engine="processes").summary
    assert signed.trajectory == calm.trajectory
    assert signed.trust is not None
    assert signed.trust.convictions == []


@pytest.mark.nightly
def test_earned_trust_changes_inputs_and_ends_with_a_conviction():
    quiet = {"network.loss": 0.0, "network.delay": 0.0, "duration": 6.0}
    ends = {}
    for information in ("unknown", "earned"):
        scenario = phalanx.load("crossing", {**quiet, "safety.information": information})
        ends[information] = phalanx.run(scenario, engine="in-process").summary
        assert ends[information].outcome is phalanx.Outcome.GUARANTEED
    assert ends["earned"].trajectory != ends["unknown"].trajectory
    hijack = [{"kind": "hijack", "at": 3.0, "agents": ["east"]}]
    changes = {**quiet, "safety.information": "earned", "faults": hijack}
    betrayed = phalanx.run(phalanx.load("crossing", changes), engine="in-process").summary
    assert betrayed.outcome is phalanx.Outcome.GUARANTEED
    assert betrayed.trust is not None
    assert {each.of for each in betrayed.trust.convictions} == {"east"}
    assert betrayed.trust.false == 0
