"""The shipped scenarios of the whole theory run to their verdicts."""

import pytest

import phalanx
from phalanx import Outcome


def run(name: str, *overrides: str) -> phalanx.Summary:
    """In this process; tests/process/test_engines.py shows that the other engine does the same."""
    summary = phalanx.run(phalanx.load(name, overrides), engine="in-process").summary
    assert summary is not None
    return summary


def failed(summary):
    return {a.name: a.first for a in summary.assumptions if a.failed}


@pytest.mark.parametrize(("name", "since"), [("surrounded", 0.0), ("pinned", 0.35)])
def test_the_infeasible_pictures_end_violated_and_say_since_when_no_control_was_left(name, since):
    summary = run(name)
    assert summary.outcome is Outcome.VIOLATED
    assert failed(summary)["non-empty K_i"] == pytest.approx(since, abs=0.015)
    assert f"non-empty K_i (since t = {failed(summary)['non-empty K_i']:.3f} s)" in summary.reason


def test_one_equal_adversary_does_no_harm():
    summary = run("one-on-one", "duration=6.0")
    assert summary.outcome is Outcome.SAFE
    assert summary.origins["backup"] == 0


def test_the_printed_margin_forgets_a_disturbance_that_the_corrected_one_bounds():
    printed = run("disturbance-gap", "duration=9.0")
    assert printed.outcome is Outcome.VIOLATED
    assert "non-empty K_i" not in failed(printed)
    corrected = run("disturbance-gap", "duration=9.0", "safety.margin=corrected")
    assert corrected.outcome is Outcome.SAFE
    assert corrected.worst_h_tot < -3.0


def test_a_proven_margin_split_shares_and_a_lossy_network_end_guaranteed():
    summary = run("guaranteed", "duration=3.0")
    assert summary.outcome is Outcome.GUARANTEED
    lost = run("guaranteed", "duration=1.0", "network.loss=0.9")
    assert lost.outcome is Outcome.GUARANTEED


@pytest.mark.parametrize(
    ("override", "why"),
    [
        ("safety.margin_scale=0.5", "less than its bound"),
        ("safety.neighbourhood=5.0", "neighbourhood"),
        ("safety.composition=lse", "shares of one row"),
        ("time.latency=0.001", "latency"),
    ],
)
def test_without_the_proof_the_same_run_is_not_guaranteed(override, why):
    summary = run("guaranteed", "duration=0.05", override)
    assert summary.outcome is not Outcome.GUARANTEED
    margin = next(a for a in summary.assumptions if a.name == "proven margin")
    assert margin.failed == 1
    assert why in margin.note
