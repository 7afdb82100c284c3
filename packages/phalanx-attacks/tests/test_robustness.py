"""The robustness of a run: its sign is the verdict's, and it falls as a run comes closer."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_attacks.robustness import evaluate, robustness, scales_of

import phalanx
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm

FINITE = st.floats(-1e3, 1e3)


@given(FINITE, st.floats(-1e3, 8.0))
def test_it_is_below_zero_exactly_if_h_was_above_and_below_one_without_a_certificate(h, left):
    found = robustness(h, left)
    assert (found < 0.0) == (h > 0.0)
    assert (found < 1.0) == (h > 0.0 or left < 0.0)


@given(FINITE, FINITE, st.floats(-1e3, 8.0))
def test_it_falls_as_h_rises(h, other, left):
    low, high = sorted((h, other))
    assert robustness(high, left) <= robustness(low, left)


def one_on_one(start: list[float], **fields: object) -> phalanx.Scenario:
    overrides = {"agents.1.start.0": start, "agents.1.dynamics.speed": 3.0, "duration": 1.0}
    return load("one-on-one", {**overrides, **fields})


def test_an_evaluation_has_the_verdict_and_the_hash_of_its_run():
    scenario = one_on_one([0.0, -1.1])
    run, evaluation = phalanx.run(scenario, engine="in-process"), evaluate(scenario)
    assert evaluation.summary.trajectory == run.summary.trajectory
    assert run.verdict == "violated"
    assert evaluation.least < 0.0
    (violation,) = run.summary.violations
    (scale,) = scales_of(build_swarm(scenario)).values()
    assert evaluation.least == pytest.approx(-violation.worst / scale)


def test_a_violation_between_two_recorded_states_makes_it_negative():
    """The adversary passes right through the other between two samples, which see it far away."""
    clocks = {f"agents.{group}.clock.period": 1.0 for group in (0, 1)}
    passes = one_on_one([0.0, -3.0], **clocks, **{"agents.1.dynamics.speed": 6.0})
    evaluation = evaluate(passes)
    assert (
        max(h.max() for h in build_swarm(passes).h_of_pairs(evaluation.track.states.x).values()) < 0
    )
    assert evaluation.summary.outcome == "violated"
    assert evaluation.least < 0.0


@pytest.mark.slow
def test_a_pursuer_that_begins_closer_has_less_robustness_on_the_same_scale():
    scales = scales_of(build_swarm(one_on_one([0.0, -4.0])))
    starts = ([0.0, -9.0], [0.0, -4.0], [0.0, -2.5], [0.0, -1.1])
    evaluations = [evaluate(one_on_one(start), scales) for start in starts]
    values = [each.least for each in evaluations]
    assert values == sorted(values, reverse=True)
    assert values[0] > 1.0 > 0.0 > values[-1]
    assert all(each.pairs == {"1-2": each.least} for each in evaluations)


def test_a_pair_that_is_under_a_certificate_throughout_has_what_is_left_of_it():
    overrides = {"duration": 0.3}
    robustness = evaluate(load("guaranteed", overrides))
    assert robustness.summary.outcome == "guaranteed"
    assert robustness.least >= 1.0
    assert len(robustness.pairs) == len(build_swarm(load("guaranteed", overrides)).safe_set.pairs)


@pytest.mark.parametrize("at", [0.0, 0.9])
def test_a_pair_does_not_count_from_when_no_normal_agent_is_in_it(at):
    turned = {"agents": ["1"], "kind": "turn", "at": at}
    robustness = evaluate(one_on_one([0.0, -1.1], faults=[turned]))
    assert robustness.summary.excluded
    assert bool(robustness.pairs) == (robustness.summary.outcome == "violated") == (at > 0.0)
