"""Sentences of a check and of a verdict: what holds, what does not, and what came before."""

from dataclasses import replace

import pytest

from phalanx.guarantee.check_report import BoundaryCondition, CheckReport
from phalanx.guarantee.findings import Unknown, findings, rounded
from phalanx.guarantee.start import CertifiedStart
from phalanx.guarantee.verdict import Assumption, Deadlock, Outcome, Violation, judge
from tests.unit.swarms import checked, swarm_of_scenario

SWARM = swarm_of_scenario("one-on-one")


@pytest.fixture(scope="module")
def report() -> CheckReport:
    return checked("one-on-one")


@pytest.mark.parametrize(
    ("name", "holding", "failing"),
    [
        ("largest h at the start", {"psi_at_start": (0.0,)}, {"psi_at_start": (0.5,)}),
        (
            "agents certified at the start",
            {"certified": CertifiedStart(True, {}, {"1": True})},
            {"certified": CertifiedStart(True, {}, {"1": False})},
        ),
        (
            "agents with an input in K_i",
            {"rows_at_start": {"1": True}},
            {"rows_at_start": {"1": False}},
        ),
        (
            "worst joint condition on ∂S_I",
            {"boundary": BoundaryCondition(1, -0.5)},
            {"boundary": BoundaryCondition(1, 0.5)},
        ),
        ("gaps in the theorem's proof", {"gaps": []}, {"gaps": ["a reason"]}),
    ],
)
def test_a_row_that_fails_has_a_sentence_and_one_that_holds_has_none(
    report, name, holding, failing
):
    for changes, holds in ((holding, True), (failing, False)):
        listed = findings(SWARM, replace(report, **changes), [], None)
        (finding,) = [finding for finding in listed if finding.row and finding.row.name == name]
        assert finding.row.holds is holds
        assert bool(finding.words) is not holds


@pytest.mark.parametrize("setting", ["set [workspace]", "fewer agents"])
def test_the_table_asks_for_the_setting_that_the_sentence_asks_for(report, setting):
    unknown = Unknown(setting, f"Constants are unknown: {setting}.")
    nothing = replace(report, formula=None, pair_formula=None, boundary=None)
    listed = findings(SWARM, nothing, [unknown], None)
    rows = {finding.row.name: finding.row for finding in listed if finding.row}
    assert rows["margin η, by the formula"].allowed == setting
    assert rows["worst joint condition on ∂S_I"].allowed == setting
    assert unknown.words in [sentence for finding in listed for sentence in finding.words]


@pytest.mark.parametrize(
    ("name", "changes", "says"),
    [
        ("fence", (), False),
        ("fence", ("network.loss=0.3",), True),
        ("crossing", (), True),
        ("faults/partition", (), False),
        ("radio", (), False),
    ],
)
def test_a_network_that_changes_nothing_is_named_before_the_run(report, name, changes, says):
    assert ("change nothing here" in words_of(report, name, *changes)) is says


def words_of(report: CheckReport, name: str, *changes: str) -> str:
    listed = findings(swarm_of_scenario(name, *changes), report, [], None)
    return " ".join(sentence for finding in listed for sentence in finding.words)


@pytest.mark.parametrize(
    ("kind", "information", "warned"),
    [
        ("hijack", "split", True),
        ("turn", "split", True),
        ("hijack", "in-flight", True),
        ("turn", "in-flight", False),
        ("hijack", "unknown", False),
        ("hijack", "worst-case", False),
    ],
)
def test_it_warns_of_a_declared_attack_that_rows_do_not_cover(report, kind, information, warned):
    fault = f"faults=[{{ kind = '{kind}', at = 0.4, agents = ['1'] }}]"
    rows = f"safety.information={information}", "safety.composition=pairs"
    words = words_of(report, "faults/hijack", fault, *rows)
    assert ("make adversaries of 1, and rows count on" in words) is warned


@pytest.mark.parametrize(
    ("q", "gap", "margin", "sampling", "theorem"),
    [(1, None, "(24)", "no time is proven", "Th. 2"), (2, 0.5, "(42)", "at most 500 ms", "Th. 5")],
)
def test_each_requirement_names_its_equation(report, q, gap, margin, sampling, theorem):
    listed = findings(SWARM, replace(report, relative_degree=q, largest_gap=gap), [], None)
    rows = {finding.row.name: finding.row for finding in listed if finding.row}
    assert rows["margin η, by the formula"].equation == margin
    assert rows["an input is in force for"].allowed == sampling
    assert rows["gaps in the theorem's proof"].equation == theorem


def test_a_pair_that_cannot_be_certified_is_named(report):
    certified = CertifiedStart(True, {"1-2": "a reason"}, {"1": True})
    listed = findings(SWARM, replace(report, certified=certified), [], None)
    words = [sentence for finding in listed for sentence in finding.words]
    assert "No guarantee: 1-2 cannot be certified: a reason." in words


def test_numbers_have_three_figures_and_no_power_of_ten():
    assert [rounded(v) for v in (0.012345, 8.0566, 36912.0)] == ["0.0123", "8.06", "36 900"]


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
