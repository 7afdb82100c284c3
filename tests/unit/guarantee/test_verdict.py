"""The verdict's sentence: what happened before a violation, and what after it."""

import pytest

from phalanx.guarantee.verdict import Assumption, Deadlock, Outcome, Violation, judge


def violation(pair: str, first: float, worst: float) -> Violation:
    return Violation(pair, first, worst, first, 0.5, 1, first, first + 0.5)


def test_of_the_deepest_violation_only_what_failed_until_its_begin_may_be_the_reason():
    """Another pair was unsafe first, but less; one assumption failed at the very instant."""
    violations = [violation("1-2", 4.0, 0.25), violation("1-3", 2.0, 0.125)]
    failed = {"start in S": 0.0, "sampling gap": 4.0, "certificates": 4.25, "resolved motion": None}
    assumptions = [Assumption(name, first=t) for name, t in failed.items()]
    outcome, reason = judge(violations, assumptions[:3], assumptions[1:])
    assert outcome is Outcome.VIOLATED
    assert reason == (
        "1-2 left the safe set, up to h = 0.25 where 0 is allowed, for 0.500 s from t = 4.000 s "
        "to 4.500 s; assumptions that had failed: start in S (since t = 0.000 s), "
        "sampling gap (since t = 4.000 s)"
    )


def test_one_waits_for_who_held_it_at_least_half_as_long_as_the_one_that_did_longest():
    held_by = {"d": 0.99, "c": 1.0, "b": 2.0}
    assert Deadlock("a", 0.0, 3.0, held_by).waits_for == ["b", "c"]
    assert Deadlock("a", 0.0, 3.0).waits_for == []


@pytest.mark.parametrize("excluded", [None, [violation("4-5", 1.0, 0.5)]])
def test_what_failed_makes_a_run_safe_and_what_is_not_counted_is_named(excluded):
    gap = Assumption("sampling gap", 2, 9, 1.0)
    for assumptions, outcome in (([], Outcome.GUARANTEED), ([gap], Outcome.SAFE)):
        judged, reason = judge([], assumptions, [gap], excluded)
        assert judged is outcome
        assert ("sampling gap (2 of 9 checks)" in reason) == bool(assumptions)
        assert ("4-5 (from t = 1.000 s)" in reason) == bool(excluded)
        assert ("pair with a normal agent" in reason) == (excluded is not None)
