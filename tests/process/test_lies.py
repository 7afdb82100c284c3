"""Lies and hijacks of members: what each does, who notices, and what no lie can do."""

import pytest
from phalanx_certify.checker.certify import certify

import phalanx
from phalanx.guarantee.verdict import Assumption, Summary

LIES = ("input", "equivocation", "replay", "apply-time", "silence")
FALSE = LIES[:-1]
"""Who is silent says nothing false."""
LIAR, BEGIN, END = "2", 0.2, 0.8


def run(name: str, folder, **overrides) -> phalanx.Run:
    scenario = phalanx.load(f"faults/lie-{name}", overrides)
    return phalanx.run(scenario, engine="in-process", out=folder)


def truthful(lied: phalanx.Run) -> Assumption:
    return next(a for a in lied.summary.theorem if a.name == "truthful broadcasts")


def test_every_lie_that_ships_is_looked_at():
    shipped = {name for name in phalanx.shipped() if name.startswith("faults/lie-")}
    assert shipped == {f"faults/lie-{name}" for name in LIES}


@pytest.fixture(scope="module")
def honest(tmp_path_factory) -> phalanx.Run:
    """All five scenarios without their lie."""
    return run("input", tmp_path_factory.mktemp("honest"), faults=[])


def test_without_a_lie_every_broadcast_is_true(honest):
    assert truthful(honest).failed == 0 < truthful(honest).checked
    assert not honest.links["lied"].any()
    assert honest.links["faults"].list.len().sum() == 0


@pytest.mark.parametrize("name", LIES)
def test_a_lie_has_its_effect_is_counted_and_named_on_every_broadcast_that_it_made(
    name, honest, tmp_path
):
    lied = run(name, tmp_path)
    assert lied.summary.trajectory != honest.summary.trajectory
    (fault,) = lied.summary.faults
    hit = lied.links.filter(lied.links["faults"].list.len() > 0)
    assert hit["faults"].explode().unique().to_list() == [fault.name]
    assert len(hit) == fault.count > 0
    assert hit["sender"].unique().to_list() == [LIAR]
    assert BEGIN <= hit["t"].min() <= hit["t"].max() < END + 0.02
    false = lied.links.filter(lied.links["lied"])
    assert false.equals(hit) == (name in FALSE)
    assert truthful(lied).failed == len(false) == fault.count * (name in FALSE)


def test_the_log_says_when_who_lied_first(tmp_path):
    (line,) = run("input", tmp_path).events.filter(text=f"agent {LIAR}: first false broadcast")["t"]
    assert BEGIN < line < BEGIN + 0.02


@pytest.mark.parametrize(
    ("information", "name"),
    [("split", "input"), ("split", "replay"), ("worst-case", "equivocation"),
     ("worst-case", "apply-time")],
)  # fmt: skip
def test_an_agent_without_received_inputs_is_not_moved_by_a_lie(information, name, tmp_path):
    believing = believes(information)
    lied_to = run(name, tmp_path / "lie", **believing).summary
    honest = run(name, tmp_path / "truth", **believing, faults=[]).summary
    assert lied_to.trajectory == honest.trajectory
    assert lied_to.certificates == honest.certificates
    assert lied_to.faults[0].count > 0


def believes(information: str) -> dict[str, str]:
    """Return the overrides of an information model; halves are of pairs."""
    composition = "pairs" if information == "split" else "lse"
    return {"safety.information": information, "safety.composition": composition}


def attacked(information: str, folder, **overrides) -> phalanx.Run:
    """Agent 2 of two turns at 0.3 s, drives at agent 1, and says that it flees."""
    lie = {"kind": "lie", "agent": LIAR, "for": 9.0, "says": "opposite"}
    table = {"duration": 1.5, "network.delay": 0.0, **believes(information)}
    scenario = phalanx.load("stale-inputs", {**table, "faults": [lie], **overrides})
    turn = phalanx.Command(0.3, phalanx.CommandKind.TURN, LIAR)
    commands = phalanx.CommandPolicy(schedule=(turn,))
    return phalanx.run(scenario, engine="in-process", out=folder, commands=commands)


@pytest.mark.parametrize("information", ["paper", "in-flight"])
def test_a_lie_that_ends_in_a_collision_was_never_certified(information, tmp_path):
    """Agent 1 evades if it receives the truth."""
    lied_to = attacked(information, tmp_path / "lie")
    honest = attacked(information, tmp_path / "truth", faults=[])
    assert honest.verdict is phalanx.Outcome.GUARANTEED
    assert lied_to.verdict is phalanx.Outcome.VIOLATED
    summary = lied_to.summary
    assert summary.certificates.uncovered_at <= summary.violations[0].first
    assert summary.certificates.certified < summary.certificates.samples


def test_worst_case_alone_keeps_off_a_member_that_lies_and_attacks(tmp_path):
    """Under `split` each relies on the other's actions, but not on its broadcasts."""
    assert attacked("worst-case", tmp_path / "w").verdict is phalanx.Outcome.GUARANTEED
    split = attacked("split", tmp_path / "s")
    assert split.verdict is phalanx.Outcome.VIOLATED
    assert split.summary.trajectory == attacked("split", tmp_path, faults=[]).summary.trajectory


@pytest.mark.parametrize("information", ["paper", "in-flight", "split"])
def test_a_guarantee_despite_a_liar_is_confirmed_by_a_judge_without_broadcasts(
    information, tmp_path
):
    """The checker is given states and applied inputs alone."""
    lied_to = run("input", tmp_path, **believes(information))
    assert lied_to.verdict is phalanx.Outcome.GUARANTEED
    recording = lied_to.recording
    assert certify(lied_to.scenario, recording.states, recording.steps)


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
    run = hijacked(information)
    assert run.verdict is phalanx.Outcome.GUARANTEED
    assert any("1 hijacked" in text for text in run.events["text"])


def test_the_theorem_promises_the_remaining_pairs_only_if_no_role_is_read():
    assert faithful(hijacked("unknown").summary) == [0]
    (failed,) = faithful(hijacked("split").summary)
    assert failed > 20
