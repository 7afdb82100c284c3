"""The shipped scenarios of the whole theory: they resolve, and run to their verdicts."""

from pathlib import Path

import numpy as np
import pytest

from phalanx.guarantee.verdict import Outcome
from phalanx.launcher.launch import launch, new_folder
from phalanx.scenario.load import ScenarioError, from_json, load, shipped, to_json
from phalanx.scenario.safety import Safety
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.laws.formation import hold
from phalanx.theory.laws.law import View
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.outputs import OutputDerivatives
from phalanx.theory.models.unicycle import Unicycle
from phalanx.theory.rows.decision import decide
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import paper_row
from phalanx.theory.safety.class_k import Linear
from phalanx.wire.session import free_endpoint


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_scenario_starts_in_its_safe_set(name):
    swarm = build_swarm(load(name))
    assert (swarm.invariants()(swarm.start())[0] <= 0).all()


def test_every_choice_of_safety_is_documented():
    page = (Path(__file__).parents[2] / "docs" / "scenario.md").read_text(encoding="utf-8")
    assert [name for name in Safety.model_fields if f"`safety.{name}`" not in page] == []


def test_simulation_2_is_the_papers():
    swarm = build_swarm(load("formation3d"))
    assert swarm.chain.relative_degree == 2
    assert len(swarm.normal) == 4
    assert len(swarm.members) == 8
    assert len(swarm.chain.set.pairs) == 6 + 16 + 40


@pytest.mark.parametrize("seed", range(5))
def test_random_obstacles_keep_apart_and_clear_of_every_start(seed):
    scenario = load("formation3d", seed=seed)
    centers = np.array([o.center for o in scenario.obstacles])
    starts = build_swarm(scenario).start().reshape(8, 6)[:, :3]
    between = np.linalg.norm(centers[:, None] - centers[None], axis=2) + 1e9 * np.eye(10)
    assert len(centers) == 10
    assert between.min() >= 10.0
    assert np.linalg.norm(centers[:, None] - starts[None], axis=2).min() >= 25.0


def test_random_obstacles_follow_the_seed_and_are_part_of_the_resolved_scenario():
    one, two = load("formation3d", seed=1), load("formation3d", seed=2)
    assert one.obstacles != two.obstacles
    assert one == load("formation3d", seed=1)
    assert from_json(to_json(one)).obstacles == one.obstacles
    assert one.scatter is None


def test_no_room_for_obstacles_is_an_error_that_names_the_field():
    with pytest.raises(ScenarioError, match="scatter: no room for 10 obstacles"):
        load("formation3d", ["scatter.apart=1000.0"])


def test_alpha_may_be_a_number_or_a_table():
    given = ['safety.alpha=[1.5, {type = "power", gain = 2.0, exponent = 3.0}]']
    first, second = load("formation3d", given).safety.class_k()
    assert first == Linear(1.5)
    assert (type(second).__name__, second.gain, second.exponent) == ("Power", 2.0, 3.0)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('safety.alpha=[{type = "power", gain = 2.0}]', r"safety.alpha.*exponent"),
        ("safety.margin=local", "safety.eta: expected no value"),
        ("safety.composition=both", "safety.composition: expected 'lse' or 'pairs'"),
        ("safety.neighbourhood=-1.0", "safety.neighbourhood"),
        ("agents.1.law.targets={4 = 'nobody'}", "law of 4: targets: expected one of"),
        ("agents.0.law.gains=[1.0]", r"gains: .*needs 2"),
    ],
)
def test_what_is_wrong_is_named(override, message):
    with pytest.raises(ScenarioError, match=message):
        build_swarm(load("formation3d", [override])).law(4)


def test_a_wall_without_a_direction_is_refused():
    with pytest.raises(ScenarioError, match=r"obstacles\.0.*normal: expected a direction"):
        load("pinned", ["obstacles.0.normal=[0.0, 0.0]"])


def test_tracking_gives_the_output_the_wanted_acceleration_but_for_drag():
    law = build_swarm(load("formation3d")).law(0)
    output = OutputDerivatives(DoubleIntegrator(2.0, 0.5, 3))
    assert law.gains == (2.0, 2.8284271247461903)
    x, u_nom = np.arange(6.0), np.array([0.3, -0.2, 1.0])
    assert output(x) == pytest.approx(x.reshape(2, 3))
    assert output.input_for(x, u_nom) == pytest.approx(u_nom)
    assert OutputDerivatives(Unicycle(1.0, 1.0)).degree == 1
    assert OutputDerivatives(SingleIntegrator(1.0)).degree == 1


def test_a_chasing_adversary_avoids_another_adversary_in_its_way():
    """Adversary 4 chases agent 0 straight through adversary 5."""
    swarm = build_swarm(load("formation3d"))
    x = swarm.start()
    parts = swarm.chain.set.parts
    x[parts[0]] = [60.0, 0, 0, 0, 0, 0]
    x[parts[4]] = [50.0, 0, 0, 2.0, 0, 0]
    x[parts[5]] = [53.0, 0, 0, 0, 0, 0]
    terms, law = swarm.terms(4)(x), swarm.law(4)
    view = _view(swarm, 4, x, terms)
    guarded = law.input(view)
    assert guarded[0] < 0
    law._team = None
    assert law.input(view)[0] > 0


def _view(swarm, i, x, terms):
    states = [x[part] for part in swarm.chain.set.parts]
    return View(i, states, swarm.normal, hold(terms.positions[i]), terms)


def test_surrounded_by_equals_no_input_keeps_the_row():
    swarm = build_swarm(load("surrounded"))
    terms = swarm.terms(0)(swarm.start())
    row = paper_row(terms, 0, {}, swarm.eta(0))
    decision = decide(terms, 0, row, np.zeros(2), NearestInput((1.0, 1.0), 4), 0.0)
    assert terms.least[0] > row.bound
    assert decision.residual > 0


def run(tmp_path, name, *overrides):
    scenario = load(name, overrides)
    folder = new_folder(tmp_path, name)
    return launch(scenario, folder, free_endpoint(), lambda _: None)


def failed(summary):
    return {a.name: a.first for a in summary.assumptions if a.failed}


@pytest.mark.swarm
@pytest.mark.parametrize(("name", "since"), [("surrounded", 0.0), ("pinned", 0.35)])
def test_the_infeasible_pictures_end_violated_and_say_since_when_no_control_was_left(
    tmp_path, name, since
):
    summary = run(tmp_path, name)
    assert summary.outcome is Outcome.VIOLATED
    assert failed(summary)["non-empty K_i"] == pytest.approx(since, abs=0.015)
    assert f"non-empty K_i (since t = {failed(summary)['non-empty K_i']:.3f} s)" in summary.reason


@pytest.mark.swarm
def test_one_equal_adversary_does_no_harm(tmp_path):
    summary = run(tmp_path, "one-on-one", "duration=6.0")
    assert summary.outcome is Outcome.SAFE
    assert summary.origins["backup"] == 0


@pytest.mark.swarm
def test_the_printed_margin_forgets_a_disturbance_that_the_corrected_one_bounds(tmp_path):
    printed = run(tmp_path, "disturbance-gap", "duration=9.0")
    assert printed.outcome is Outcome.VIOLATED
    assert "non-empty K_i" not in failed(printed)
    corrected = run(tmp_path, "disturbance-gap", "duration=9.0", "safety.margin=corrected")
    assert corrected.outcome is Outcome.SAFE
    assert corrected.worst_h_tot < -3.0


@pytest.mark.swarm
def test_a_proven_margin_split_shares_and_a_lossy_network_end_guaranteed(tmp_path):
    summary = run(tmp_path, "guaranteed", "duration=3.0")
    assert summary.outcome is Outcome.GUARANTEED
    lost = run(tmp_path, "guaranteed", "duration=1.0", "network.loss=0.9")
    assert lost.outcome is Outcome.GUARANTEED


@pytest.mark.swarm
@pytest.mark.parametrize(
    ("override", "why"),
    [
        ("safety.margin_scale=0.5", "scaled down"),
        ("safety.neighbourhood=5.0", "neighbourhood"),
        ("safety.composition=lse", "shares of h_tot"),
        ("time.latency=0.001", "latency"),
    ],
)
def test_without_the_proof_the_same_run_is_not_guaranteed(tmp_path, override, why):
    summary = run(tmp_path, "guaranteed", "duration=0.5", override)
    assert summary.outcome is not Outcome.GUARANTEED
    margin = next(a for a in summary.assumptions if a.name == "proven margin")
    assert margin.failed == 1
    assert why in margin.note
