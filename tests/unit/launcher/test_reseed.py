"""A scenario's `reseed`: the run is the same up to a time, and drawn again from then on."""

import pytest

import phalanx

AT = 0.25
SHORT = {"duration": 0.5, "seed": 3}
RANDOM = {
    "clocks and disturbances": {},
    "links": {
        "network.loss": {"mean": 0.3, "burst": 3.0},
        "network.delay": {"time": 0.02, "jitter": 0.02, "correlation": 0.3},
        "network.duplicate": 0.2,
        "network.reorder": {"probability": 0.3},
    },
    "robots": {
        "time.latency": 0.004,
        "network.sample.loss": {"mean": 0.2, "burst": 4.0},
        "network.actuation": {"loss": 0.1, "delay": {"low": 0.0, "high": 0.015}},
        "faults": [{"kind": "sensor", "at": 0.1, "for": 0.4, "noise": {"x": 0.1}}],
    },
    "lies": {"faults": [{"kind": "lie", "agent": "2", "at": 0.1, "for": 0.4, "equivocate": True}]},
    "times of faults": {"faults": [{"kind": "clock", "rate": 20.0, "drift": 0.5, "for": 0.1}]},
}
QUIET = {
    **{f"agents.{group}.clock.jitter": 0.0 for group in (0, 1)},
    **{f"agents.{group}.disturbance.bound": 0.0 for group in (0, 1)},
}
"""Nothing is random but what a case adds."""


def halves(reseed: list[dict[str, float]], **overrides: object) -> list[str]:
    """Return all states and decided broadcasts up to AT, and those after it."""
    scenario = phalanx.load("unicycles", {**SHORT, **overrides, "reseed": reseed})
    recording = phalanx.run(scenario, engine="in-process").recording
    records = [*recording.states, *((step.t, step.agent, step.fates) for step in recording.steps)]
    times = [each.t for each in (*recording.states, *recording.steps)]
    return [
        str([record for t, record in zip(times, records, strict=True) if (t <= AT) is before])
        for before in (True, False)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("what", RANDOM)
def test_nothing_changes_before_it_and_the_rest_after_it(what):
    quiet = {} if what == "clocks and disturbances" else QUIET
    overrides = {**quiet, **RANDOM[what]}
    before, after = halves([], **overrides)
    again, after_reseed = halves([{"at": AT, "seed": 8}], **overrides)
    assert again == before
    assert after_reseed != after


@pytest.mark.slow
def test_with_the_runs_own_seed_nothing_changes():
    overrides = {**RANDOM["links"], **RANDOM["robots"]}
    assert halves([], **overrides) == halves([{"at": AT, "seed": 3}], **overrides)


@pytest.mark.slow
def test_a_second_one_keeps_what_the_first_has_drawn():
    first = {"at": 0.1, "seed": 5}
    (before, one), (again, other) = (
        halves(reseed) for reseed in ([first], [first, {"at": AT, "seed": 6}])
    )
    assert before == again
    assert one != other


@pytest.mark.slow
def test_its_recording_carries_it_and_is_verified():
    scenario = phalanx.load("unicycles", {**SHORT, "reseed": [{"at": AT, "seed": 8}]})
    run = phalanx.run(scenario, engine="in-process")
    assert [(each.at, each.seed) for each in phalanx.open(run.folder).scenario.reseed] == [(AT, 8)]
    assert phalanx.verify(run, engine="in-process")
