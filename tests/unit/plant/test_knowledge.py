"""Knowledge held: sets by radio had the truth in them, or the judge names why not."""

import pytest

import phalanx

pytestmark = pytest.mark.slow

TWO = {
    "duration": 1.5,
    "agents.0.count": 2,
    "agents.0.start": [[6.0, 0.2, 0.0, 0.0], [-6.0, 0.0, 0.0, 0.0]],
    "agents.0.goal": [[-6.0, 0.0], [6.0, 0.0]],
    "network.loss": 0.2,
}
OF_TWO = {"at": 0.5, "agents": ["2"]}
UNKNOWN_STARTS = {"agents.0.radio.starts_known": False}


def lie(at: float, **fields):
    return {"faults": [{"kind": "lie", "agent": "2", "at": at, "for": 9.0, **fields}]}


def wrong_sensor(bias: float, error: float):
    sensor = {"kind": "sensor", "bias": {"x": bias}, "for": 9.0, **OF_TWO, "at": 0.0}
    return {"faults": [sensor], "agents.0.radio.position_error": error, **UNKNOWN_STARTS}


BROKEN = {
    "nothing": ({}, None),
    "a lie that is found": (lie(0.5, shift=[1.0, 0.0, 0.0, 0.0]), None),
    "a lie that its set makes good": (lie(1.0, drift=[0.02, 0.0, 0.0, 0.0]), None),
    "a lie from the start": (
        {**lie(0.0, shift=[3.0, 0.0, 0.0, 0.0]), **UNKNOWN_STARTS},
        "of 2, which stated a false place",
    ),
    "an error that is declared": (wrong_sensor(0.05, 0.06), None),
    "an error that is not": (wrong_sensor(3.0, 0.0), "of 2, which stated a false place"),
    "a hijack": ({"faults": [{"kind": "hijack", **OF_TWO}]}, "of 2, which attacks"),
    "a stuck actuator": (
        {"faults": [{"kind": "actuator", "for": 0.3, **OF_TWO}]},
        "of 2, which held an input for too long",
    ),
    "a kill": ({"faults": [{"kind": "kill", **OF_TWO}]}, "of 2, which held an input for too long"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_knowledge_is_held_or_it_is_named_why_not_and_the_same_when_judged_again(case, tmp_path):
    changes, why = BROKEN[case]
    scenario = phalanx.load("radio", {**TWO, "faults": [], **changes})
    run = phalanx.run(scenario, engine="in-process", out=tmp_path)
    (assumption,) = [a for a in run.summary.theorem if a.name == "knowledge held"]
    assert assumption.checked > 40
    assert bool(assumption.failed) == (why is not None)
    assert why is None or f"not so {why} (" in assumption.note
    assert run.judge_again().theorem == run.summary.theorem


def test_a_second_hold_that_is_too_long_counts_as_the_first_did():
    faults = [{"kind": "actuator", "for": 0.2, **OF_TWO, "at": at} for at in (0.3, 1.0)]
    failed = []
    for number in (1, 2):
        scenario = phalanx.load("radio", {**TWO, "faults": faults[:number]})
        summary = phalanx.run(scenario, engine="in-process").summary
        failed += [a.failed for a in summary.theorem if a.name == "knowledge held"]
    assert failed[1] > 1.5 * failed[0] > 0


def test_it_is_no_matter_where_one_state_is_believed():
    run = phalanx.run(phalanx.load("radio-naive", {**TWO, "faults": []}), engine="in-process")
    assert not [a for a in run.summary.theorem if a.name == "knowledge held"]
