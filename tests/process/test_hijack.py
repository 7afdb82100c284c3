"""Hijacks in secret: broadcasts look honest, and only the plant knows."""

import pytest

import phalanx
from phalanx.guarantee.verdict import Summary

SCENARIO = "faults/hijack"
PAIRS = {"safety.composition": "pairs", "safety.margin": "integrated", "safety.eta": 0.0}
STEEP = {"safety.alpha": [11.0]}


def hijacked(information: str, **changes: object) -> phalanx.Run:
    overrides = {"safety.information": information, **PAIRS, **STEEP, **changes}
    return phalanx.run(phalanx.load(SCENARIO, overrides), engine="in-process")


def faithful(summary: Summary) -> list[int]:
    return [a.failed for a in summary.theorem if a.name == "faithful agents"]


def test_a_hijacked_agent_broadcasts_what_its_own_filter_says():
    run = hijacked("in-flight")
    claimed = run.links.filter((run.links["sender"] == "1") & run.links["lied"])
    assert len(claimed) > 20
    assert claimed["t"].min() >= 0.4
    applied = run.inputs.filter(agent="1").filter(run.inputs.filter(agent="1")["t"] > 0.42)
    assert set(applied["origin"]) == {"attack"}


@pytest.mark.parametrize("information", ["unknown", "worst-case"])
def test_pairs_with_a_remaining_normal_agent_stay_guaranteed(information):
    summary = hijacked(information).summary
    assert summary.outcome is phalanx.Outcome.GUARANTEED
    assert any("1 hijacked" in text for text in hijacked(information).events["text"])


def test_the_theorem_promises_the_remaining_pairs_only_if_no_role_is_read():
    assert faithful(hijacked("unknown").summary) == [0]
    (failed,) = faithful(hijacked("split").summary)
    assert failed > 20
