"""Findings of a check: a row of the table and its sentences say the same."""

from dataclasses import replace

import pytest

from phalanx.guarantee.check_report import BoundaryCondition, CheckReport
from phalanx.guarantee.findings import Unknown, findings, rounded
from phalanx.guarantee.start import CertifiedStart
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
