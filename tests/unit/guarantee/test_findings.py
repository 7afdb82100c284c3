"""Sentences of a check and of a verdict: what holds, what does not, and what came before."""

from dataclasses import replace

import numpy as np
import pytest
from msgspec.structs import replace as replace_fields

from phalanx.guarantee.check_report import BoundaryCondition, CheckReport, Requirement
from phalanx.guarantee.findings import Unknown, findings, rounded
from phalanx.guarantee.formula import boundary
from phalanx.guarantee.proof_gaps import proof_gaps
from phalanx.guarantee.start import CertifiedStart
from phalanx.guarantee.verdict import (
    Assumption,
    CertificateSummary,
    Deadlock,
    Outcome,
    Percentiles,
    Summary,
    Violation,
    judge,
    percentiles,
)
from tests.unit.swarms import checked, swarm_of_scenario

SWARM = swarm_of_scenario("one-on-one")


@pytest.fixture(scope="module")
def report() -> CheckReport:
    return checked("one-on-one")


@pytest.mark.parametrize(
    ("name", "holding", "failing"),
    [
        ("largest h at the start", {"psi_at_start": (0.0, -1.0)}, {"psi_at_start": (0.5, -1.0)}),
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


def rows_of(report: CheckReport, *overrides: str, **changes) -> dict[str, Requirement]:
    """Return the table's rows by their names, of a report that was changed."""
    swarm = swarm_of_scenario("one-on-one", *overrides)
    listed = findings(swarm, replace(report, **changes), [], None)
    return {finding.row.name: finding.row for finding in listed if finding.row}


@pytest.mark.parametrize(
    ("q", "control", "equations"),
    [
        (1, "distributed", ["(2)", "(30)", "(24)", "Th. 2"]),
        (2, "distributed", ["(38)", "(44)", "(42)", "Th. 5"]),
        (1, "centralised", ["(2)", "(28)", "(24)", "Th. 1"]),
    ],
)
def test_each_requirement_names_its_equation(report, q, control, equations):
    named = "largest h at the start", "agents with an input in K_i", "margin η, by the formula"
    rows = rows_of(report, f"safety.control={control}", relative_degree=q)
    assert [rows[name].equation for name in (*named, "gaps in the theorem's proof")] == equations


def test_an_input_may_be_in_force_for_as_long_as_rows_stay_solvable(report):
    for gap, allowed, holds in (
        (None, "no time is proven", False),
        (0.5, "at most 500 ms", True),
        (0.001, "at most 1 ms", False),
    ):  # fmt: skip
        row = rows_of(report, largest_gap=gap)["an input is in force for"]
        assert (row.allowed, row.holds) == (allowed, holds)


def test_a_margin_that_is_computed_may_have_any_bound_and_a_given_one_the_largest_at_least(report):
    none, bounds = {"1": None}, {"1": 0.5, "2": 0.25}
    (computed,) = (row for name, row in rows_of(report, eta_paper=none, eta_local=bounds).items()
                   if name.startswith("margin"))  # fmt: skip
    assert computed == ("margin η, at the start", "computed, 0.5 m²/s", "any bound", "(24)", True)
    for eta, holds in ((0.5, True), (0.375, False)):
        row = rows_of(report, eta_paper={"1": eta}, eta_local=bounds)["margin η, as a bound"]
        assert (row.allowed, row.holds) == ("at least 0.5 m²/s", holds)


@pytest.mark.parametrize(
    ("q", "margin", "says"), [(1, "paper", False), (2, "paper", True), (2, "corrected", False)]
)
def test_the_papers_margin_leaves_out_disturbances_of_later_psi(report, q, margin, says):
    listed = findings(
        swarm_of_scenario("one-on-one", "safety.composition=pairs", f"safety.margin={margin}"),
        replace(report, relative_degree=q), [], None,
    )  # fmt: skip
    assert ("leaves out the effect" in " ".join(sentences(listed))) is says


def sentences(listed) -> list[str]:
    return [sentence for finding in listed for sentence in finding.words]


def test_what_rows_lack_for_a_proof_and_who_rests_is_said_whole(report):
    for gaps, says in ((["a reason"], True), ([], False)):
        said = sentences(findings(SWARM, replace(report, gaps=gaps), [], None))
        lacking = "margin = 'integrated', information = 'split', eta = 0."
        assert (
            f"For proven rows set in [safety]: composition = 'pairs', {lacking}" in said
        ) is says
    rests = "Without goal, slots or flows: 1. A law that tracks keeps them at their start."
    for goal, says in ((), True), (("agents.0.goal=[[3.0, 0.0]]",), False):
        said = sentences(findings(swarm_of_scenario("one-on-one", *goal), report, [], None))
        assert (rests in said) is says


@pytest.mark.parametrize(
    ("override", "gap"),
    [
        ("safety.neighbourhood=9.0", "with safety.neighbourhood"),
        ("time.latency=0.002", "until time.latency is over"),
    ],
)
def test_a_gap_of_the_proof_has_a_sentence_and_a_proven_scenario_none(override, gap):
    proven = "safety.composition=pairs", "safety.margin=integrated", "safety.eta=0"
    assert proof_gaps(swarm_of_scenario("one-on-one", *proven)) == []
    (sentence,) = proof_gaps(swarm_of_scenario("one-on-one", *proven, override))
    assert sentence.startswith(gap)


@pytest.mark.parametrize("outside", [[3.0, 4.0], [0.0, -1.5]])
def test_the_boundary_is_met_on_the_way_out_from_the_start(outside):
    start, outside = np.array([0.5, 0.0]), np.array(outside)
    met = boundary(lambda x: x @ x[:, None] - 1.0, start, outside)
    assert met @ met == pytest.approx(1.0)
    share = (met - start) / (outside - start)
    assert share[0] == pytest.approx(share[1])
    assert 0.0 < share[0] < 1.0


@pytest.mark.slow
def test_a_check_looks_at_the_boundary_from_a_start_inside_and_knows_no_margin_that_is_computed():
    area = "workspace.x=[-3.0, 3.0]", "workspace.y=[-3.0, 3.0]"
    computed = "safety.composition=pairs", "safety.margin=integrated", "safety.eta=0"
    inside = checked("one-on-one", *area, *computed)
    assert (inside.boundary.states, inside.eta_paper) == (200, {"1": None})
    assert checked("one-on-one", *area, "agents.1.start=[[0.0, -0.9]]").boundary is None


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


def test_how_many_excursions_a_pair_had_is_said_of_two_and_more():
    twice = Violation("1-2", 1.0, 0.25, 1.25, 0.5, 2, 2.0, None)
    assert twice.times == "0.500 s from t = 1.000 s on, in 2 excursions"


def test_of_a_time_the_hundredth_part_was_longer_than_its_p99():
    some = percentiles("answer", [0.001 * k for k in range(101)])
    assert (some.count, some.p50, some.p99, some.most) == (101, 0.05, 0.099, 0.1)
    assert percentiles("none", []) == Percentiles("none", 0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("outcome", "failed", "says"),
    [(Outcome.GUARANTEED, 2, True), (Outcome.GUARANTEED, 0, False), (Outcome.SAFE, 2, False)],
)
def test_a_guarantee_says_that_the_theorem_alone_would_not_have_sufficed(outcome, failed, says):
    theorem = [Assumption("proven margin", failed, 3), Assumption("start in S_I", 0, 1)]
    summary = Summary(
        outcome, "", 8.0, 0, "", -1.0, 0.0, "1-2", -1.0, 0.0, 9, {}, [], theorem,
        CertificateSummary(), [], {}, 2.0,
    )  # fmt: skip
    sentence = (
        "Proven by certificates. The paper's theorem alone would not have sufficed: "
        "proven margin failed in 2 of 3 checks."
    )
    assert summary.on_theorem == (sentence if says else "")
    assert summary.real_time_factor == 4.0
    assert replace_fields(summary, wall_time=0.0).real_time_factor == 0.0
