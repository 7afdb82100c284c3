"""Two engines, one trajectory: what the fast one says holds for the real one, to the last bit."""

import pytest

import phalanx

pytestmark = pytest.mark.swarm

DURATION = 1.5
"""Of each run [s]: past the first backups, losses and late broadcasts of the shipped scenarios."""
VARIANTS = {
    "losses and delays": {"network.loss": 0.3, "network.delay": {"low": 0.0, "high": 0.05}},
    "latency": {"time.latency": 0.004, "safety.information": "in-flight"},
    "one controller": {"safety.control": "centralised"},
    "one row for each pair": {"safety.composition": "pairs", "safety.information": "split"},
    "agents that come and go": {"safety.neighbourhood": 4.7, "agents.1.sensing": 7.6},
    "adverse disturbances": {"agents.0.disturbance.kind": "adverse"},
}


def trajectory(scenario: phalanx.Scenario, engine: phalanx.Engine) -> tuple[str, int]:
    summary = phalanx.run(scenario, engine=engine).summary
    assert summary is not None
    return summary.trajectory, summary.steps


@pytest.mark.parametrize("name", phalanx.shipped())
def test_every_shipped_scenario_has_one_trajectory(name: str) -> None:
    shipped = phalanx.load(name, seed=1)
    scenario = phalanx.load(name, {"duration": min(DURATION, shipped.duration)}, seed=1)
    assert trajectory(scenario, "in-process") == trajectory(scenario, "processes")


@pytest.mark.parametrize("overrides", VARIANTS.values(), ids=VARIANTS)
def test_whatever_network_clock_and_controller_the_trajectory_is_one(overrides: dict) -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION, **overrides})
    assert trajectory(scenario, "in-process") == trajectory(scenario, "processes")


def test_commands_take_effect_alike_on_both_engines() -> None:
    scenario = phalanx.load("unicycles", {"duration": DURATION})
    kinds = phalanx.CommandKind
    schedule = (
        phalanx.Command(0.2, kinds.LOSS, value=0.5),
        phalanx.Command(0.4, kinds.FREEZE, "1"),
        phalanx.Command(0.5, kinds.TURN, "2"),
        phalanx.Command(0.7, kinds.THAW, "1"),
        phalanx.Command(0.9, kinds.KILL, "3"),
    )
    policy = phalanx.CommandPolicy(schedule=schedule)
    runs = [phalanx.run(scenario, engine=e, commands=policy) for e in ("in-process", "processes")]
    first, second = (run.summary for run in runs)
    assert first.trajectory == second.trajectory
    assert runs[0].events.equals(runs[1].events)
    undisturbed = phalanx.run(scenario, engine="in-process").summary
    assert undisturbed.trajectory != first.trajectory


def test_a_run_of_one_engine_is_verified_on_the_other() -> None:
    run = phalanx.run(phalanx.load("stale-inputs", {"duration": 1.0}), engine="in-process")
    verification = phalanx.verify(run, engine="processes")
    assert verification, verification.difference
    assert verification.steps == run.summary.steps
