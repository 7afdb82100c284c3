"""The shipped scenarios of the whole theory run to their verdicts."""

import pytest
from phalanx_certify.checker.certify import Certification, certify

import phalanx
from phalanx import Outcome
from tests.unit.tables import group, swarm_table


def run(name: str, *overrides: str) -> phalanx.Summary:
    """Run in this process; tests/process/test_engines.py compares the engines."""
    summary = phalanx.run(phalanx.load(name, overrides), engine="in-process").summary
    assert summary is not None
    return summary


def failed(summary):
    """The theorem's assumptions that failed, with the time of the first failure [s]."""
    return {a.name: a.first for a in summary.theorem if a.failed}


@pytest.mark.parametrize(("name", "since"), [("surrounded", 0.0), ("pinned", 0.35)])
def test_the_infeasible_pictures_end_violated_and_say_since_when_no_control_was_left(name, since):
    summary = run(name)
    assert summary.outcome is Outcome.VIOLATED
    assert failed(summary)["non-empty K_i"] == pytest.approx(since, abs=0.015)
    assert f"non-empty K_i (since t = {failed(summary)['non-empty K_i']:.3f} s)" in summary.reason


def test_one_equal_adversary_does_no_harm():
    summary = run("one-on-one", "duration=6.0")
    assert summary.outcome is Outcome.GUARANTEED
    assert summary.origins["backup"] == 0


@pytest.mark.parametrize(
    ("name", "without"),
    [("unknown", "safety.information=split"), ("prove", "safety.prove=false"), ("centralised", "")],
)
def test_a_mode_of_safety_has_a_scenario_that_is_guaranteed_with_it_alone(name, without):
    assert run(name).outcome is Outcome.GUARANTEED
    assert not without or run(name, without).outcome is Outcome.VIOLATED


@pytest.mark.nightly
def test_the_printed_margin_forgets_a_disturbance_that_the_corrected_one_bounds():
    printed = run("disturbance-gap", "duration=9.0")
    assert printed.outcome is Outcome.VIOLATED
    assert "non-empty K_i" not in failed(printed)
    pairs = "safety.composition=pairs", "safety.margin=corrected"
    corrected = run("disturbance-gap", "duration=9.0", *pairs)
    assert corrected.outcome is Outcome.GUARANTEED
    assert corrected.largest_h_tot < -3.0


@pytest.mark.parametrize("duration", [3.0, pytest.param(12.0, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("name", ["unicycles", "formation3d"])
def test_the_papers_own_simulations_are_guaranteed_although_its_theorem_does_not_apply(
    name, duration
):
    """The printed margins leave K_i empty at some samples; certificates do not depend on it."""
    summary = run(name, f"duration={duration}")
    assert summary.outcome is Outcome.GUARANTEED
    assert summary.certificates.certified == summary.certificates.samples > 0
    assert summary.certificates.shortest > 1.0
    assert "proven margin" in failed(summary)


@pytest.mark.nightly
def test_without_a_margin_the_certificate_is_gone_before_the_pair_leaves():
    summary = run("unicycles", "duration=24.0", "safety.eta=0")
    assert summary.outcome is Outcome.VIOLATED
    first = min(v.first for v in summary.violations)
    assert 0.0 < summary.certificates.uncovered_at < first
    assert "certificates (since" in summary.reason


def test_a_proven_margin_split_shares_and_a_lossy_network_give_the_theorem_all_it_needs():
    summary = run("guaranteed", "duration=3.0")
    assert summary.outcome is Outcome.GUARANTEED
    assert failed(summary) == {}
    lost = run("guaranteed", "duration=1.0", "network.loss=0.9")
    assert lost.outcome is Outcome.GUARANTEED


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("name", "duration", "seed"),
    [("heading-aware", 2.0, 1), ("heading-aware", 2.0, 2), ("formation3d-distance", 8.0, 1)],
)
def test_with_a_distance_in_metres_a_proof_is_to_be_had(name, duration, seed):
    summary = run(name, f"duration={duration}", f"seed={seed}")
    assert summary.outcome is Outcome.GUARANTEED
    assert summary.certificates.shortest > 1.0
    assert failed(summary) == {}


def turned(
    at: float,
    obstacle: list[float],
    adversary: list[float],
    victim: float = 3.5,
    killed: float = 2.0,
) -> phalanx.Run:
    """Agent 1 turns at a time and makes for agent 2, a slow one, through what is on its way."""
    agents = (
        ("1", "normal", 4.0, "worst", [0.0, 0.0]),
        ("2", "normal", 1.0, "track-velocity", [0.0, victim]),
        ("3", "adversary", 4.0, "track-velocity", adversary),
    )
    groups = [
        group(name, role, [start], law, speed=speed) for name, role, speed, law, start in agents
    ]
    obstacles = [{"center": obstacle, "clearance": 0.5}]
    scenario = phalanx.load(
        swarm_table(*groups, safety={"rho": 1.0, "eta": 0.0}, obstacles=obstacles)
    )
    turn = phalanx.Command(at, phalanx.CommandKind.TURN, "1")
    kill = phalanx.Command(killed, phalanx.CommandKind.KILL, "1")
    commands = phalanx.CommandPolicy((turn, kill))
    return phalanx.run(scenario, engine="in-process", commands=commands)


def certified(run: phalanx.Run, turned: dict[str, float]) -> Certification:
    recording = run.recording
    return certify(recording.scenario, recording.states, recording.steps, turned=turned)


def test_what_a_turned_agent_does_to_itself_is_named_and_not_counted():
    run = turned(0.1, obstacle=[0.0, 2.0], adversary=[0.5, 2.5], victim=6.0)
    pairs = [violation.pair for violation in run.summary.excluded]
    assert sorted(pairs) == ["1-3", "1-obstacle 0"]
    assert run.summary.violations == []
    assert run.verdict is Outcome.GUARANTEED
    for pair in pairs:
        assert f"{pair} (from t = " in run.summary.reason
        assert any(
            f"{pair} left the safe set, not counted" in log.text for log in run.recording.log
        )
    assert certified(run, {"1": 0.1})
    assert certified(run, {}).gap.pair in pairs


def test_its_own_pairs_need_no_certificate_even_if_it_falls_silent_at_once():
    run = turned(0.105, obstacle=[0.0, -0.6], adversary=[0.0, -9.0], victim=9.0, killed=0.107)
    assert run.verdict is Outcome.GUARANTEED


def test_before_its_turn_the_same_counts():
    run = turned(0.5, obstacle=[0.0, 0.2], adversary=[0.0, -8.0])
    (violation,) = run.summary.violations
    assert (violation.pair, violation.first) == ("1-obstacle 0", 0.0)
    assert violation.duration <= 0.5 + 1e-9
    assert run.verdict is Outcome.VIOLATED
    assert certified(run, {"1": 0.5}).gap.t == 0.0


def test_what_a_turned_agent_does_to_a_normal_one_counts():
    run = turned(0.1, obstacle=[0.0, -8.0], adversary=[0.0, -9.0])
    assert [violation.pair for violation in run.summary.violations] == ["1-2"]
    assert run.summary.excluded == []
    certification = certified(run, {"1": 0.1})
    assert certification.gap.pair == "1-2"
    assert certification.gap.t < run.summary.violations[0].first
