"""Checks of the shipped scenarios, compared with hand calculations and actual runs."""

import math

import numpy as np
import pytest

from phalanx.guarantee.check import check
from phalanx.guarantee.check_report import CheckReport
from phalanx.guarantee.formula import Region, constants, random_states
from phalanx.guarantee.proof_gaps import alpha_advice, proof_gaps
from phalanx.guarantee.start import rows_at_start
from phalanx.scenario.load import load
from phalanx.theory.margins.margin import MarginConstants
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation
from tests.unit.swarms import checked, rows_of_scenario, swarm_of_scenario


@pytest.fixture(scope="module")
def guaranteed() -> CheckReport:
    return checked("guaranteed")


@pytest.fixture(scope="module")
def paper() -> CheckReport:
    """Simulation 1 as printed."""
    return checked("unicycles")


def test_certificates_allow_a_guarantee_where_the_papers_theorem_proves_nothing(guaranteed, paper):
    assert guaranteed.may_be_guaranteed
    assert not guaranteed.gaps
    assert paper.may_be_guaranteed
    assert any("η is a given number" in gap for gap in paper.gaps)
    assert not any("No guarantee" in word for word in paper.words)


@pytest.mark.parametrize("information", ["paper", "in-flight", "worst-case"])
def test_a_liar_is_named_where_rows_use_its_claims(information: str):
    lie = 'faults=[{ kind = "lie", agent = "2", for = 1.0, says = "zero" }]'
    words = " ".join(checked("stale-inputs", f"safety.information={information}", lie).words)
    named = "broadcasts of 2 claim inputs that are not applied" in words
    assert named == (information in ("paper", "in-flight"))


@pytest.mark.parametrize(
    ("override", "limit"),
    [("safety.information=split", 1 / (0.012 * math.e)), ("safety.information=paper", 1 / 0.012)],
)
def test_a_steeper_alpha_than_is_proven_is_a_gap(override, limit):
    """Halves go by two agents' samples: κ τ <= 1/e; a whole row by its own: κ τ <= 1."""
    for gain, proven in ((0.99 * limit, True), (1.01 * limit, False)):
        swarm = swarm_of_scenario("guaranteed", override, f"safety.alpha=[{gain}]")
        gaps = [gap for gap in proof_gaps(swarm) if "steeper than what is proven" in gap]
        assert proven is not bool(gaps)
        assert proven or f"at most {limit:.3g}" in gaps[0]


@pytest.mark.parametrize(
    ("gain", "words"), [(2.0, "2, is weak"), (20.0, None), (80.0, "80, is steep")]
)
@pytest.mark.parametrize("margin", ["local", "integrated"])
def test_an_alpha_that_serves_is_proposed_where_a_proof_is_asked_for(margin, gain, words):
    swarm = swarm_of_scenario("guaranteed", f"safety.margin={margin}", f"safety.alpha=[{gain}]")
    advice = alpha_advice(swarm)
    assert len(advice) == (words is not None)
    assert words is None or (words in advice[0] and "about 0.25/τ = 20.8" in advice[0])
    assert not alpha_advice(swarm_of_scenario("unicycles"))


def test_it_says_what_is_taken_for_granted_of_roles_unless_no_role_is_read(guaranteed):
    granted = "Taken for granted: agents know who is an adversary"
    (sentence,) = [word for word in guaranteed.words if word.startswith(granted)]
    assert "safety.information = 'unknown'" in sentence
    words = checked("guaranteed", "safety.information=unknown").words
    assert not any(word.startswith(granted) for word in words)


def test_the_papers_margin_is_far_below_its_own_formula(paper):
    assert paper.eta_paper == dict.fromkeys("123", 8.0566)
    assert paper.formula.eta > 500
    assert any("a choice, not a bound" in word for word in paper.words)


def test_the_worst_pair_needs_a_smaller_margin_than_all_pairs_composed_and_it_is_proven(paper):
    assert paper.pair_formula.proven
    assert not paper.formula.proven
    assert paper.pair_formula.eta < paper.formula.eta / 2


def test_theorem_3_is_refuted_for_simulation_1(paper):
    """The best heading at d = 1 leaves about -8 + 4 + 8.06 > 0; other headings leave more."""
    assert paper.boundary.states == 200
    assert paper.boundary.holds is False
    assert paper.boundary.worst > -8 + 4 + 8.06


def test_on_the_boundary_an_equal_adversary_leaves_eta_and_a_slower_one_less_than_nothing():
    """L_g h = -2 D at |D| = 1: flight and chase sum to 2 (|D_1| + |D_2|) (v_chase - v_flight)."""
    equal = checked("one-on-one").boundary
    assert equal.worst == pytest.approx(0.3)
    assert equal.holds is False
    slower = checked("one-on-one", "agents.1.dynamics.speed=0.5").boundary
    assert 0.3 - math.sqrt(2) < slower.worst < 0.3 - 1.0
    assert slower.holds is None


def test_other_seeds_ask_other_states_and_the_same_seed_the_same():
    """Nothing of a check is drawn but from (seed, purpose)."""
    low, high = np.array([0.0, -1.0, 5.0, 5.0]), np.array([1.0, 1.0, 5.5, 9.0])

    def draw_states(seed: int, purpose: str) -> np.ndarray:
        return np.array(list(random_states(seed, purpose, low, high, 300)))

    states = draw_states(0, "inside")
    assert (states == draw_states(0, "inside")).all()
    assert not (states == draw_states(1, "inside")).any()
    assert not (states == draw_states(0, "boundary")).any()
    assert states.min(axis=0) == pytest.approx(low, abs=0.05)
    assert states.max(axis=0) == pytest.approx(high, abs=0.05)


def test_the_constants_of_one_pair_are_the_hand_calculation_and_proven():
    """Single integrators: L_g h = -2 D, so c_g = 2 ‖I, -I‖ = 4, and c_h = sup 2 ‖D‖."""
    members = [Member("a", SingleIntegrator(1.0), False), Member("b", SingleIntegrator(2.0), True)]
    chain = build_chain(compose(members, [], Separation(1.0), 1.0), [1.5])
    low, high = np.full(4, -3.0), np.full(4, 3.0)
    bounds = constants(chain, Region(low, high, np.zeros((1, 4))), [0.1, 0.2])
    assert all(constant.how == "interval" for constant in bounds.values())
    assert bounds["c_f"].value == 0.0
    assert bounds["c_g"].value == pytest.approx(4.0)
    assert bounds["c_h"].value == pytest.approx(2 * math.hypot(6, 6))
    assert bounds["u_max"].value == pytest.approx(math.sqrt(2))
    assert bounds["c_gamma"].value == pytest.approx(2 * math.hypot(2, 2) * math.sqrt(2))
    assert bounds["c_alpha"].value == pytest.approx(1.5 * 2 * math.hypot(6, 6) * math.sqrt(2))
    speeds = math.sqrt(2) + 0.1, 2 * math.sqrt(2) + 0.2
    assert bounds["mu"].value == pytest.approx(math.hypot(*speeds))
    eta = MarginConstants(**{k: c.value for k, c in bounds.items()}).eta(0.01, 0.3)
    assert eta > bounds["c_h"].value * 0.3


def test_beyond_the_largest_gap_the_start_has_no_solution_and_below_it_has(guaranteed):
    gap = guaranteed.largest_gap
    assert gap > 0.012
    for factor, holds in ((0.8, True), (1.3, False)):
        period = f"agents.0.clock.period={gap * factor - 0.002}"
        rows = rows_of_scenario("guaranteed", "safety.margin=local", period)
        assert all(rows_at_start(rows).values()) is holds


def test_only_the_printed_information_model_minds_delay(guaranteed, paper):
    assert paper.largest_delay == 0.0
    assert guaranteed.largest_delay == math.inf


def test_one_controller_minds_no_delay_and_has_a_solution_where_single_agents_have_none(paper):
    central = checked("unicycles", "safety.control=centralised")
    assert central.largest_delay == math.inf
    assert not paper.rows_at_start["3"]
    assert all(central.rows_at_start.values())
    assert any("sample together" in gap for gap in central.gaps)


@pytest.mark.parametrize(("jitter", "together"), [(0.0, True), (0.001, False)])
def test_one_controller_needs_agents_whose_clocks_have_no_jitter(jitter, together):
    clock = f"agents.0.clock.jitter={jitter}"
    gaps = proof_gaps(swarm_of_scenario("one-on-one", "safety.control=centralised", clock))
    assert any("sample together" in gap for gap in gaps) is not together


def test_states_without_known_bounds_are_asked_for_by_name():
    report = checked("disturbance-gap")
    assert report.formula is None
    assert any("vx, vy, vz in [workspace]" in word for word in report.words)
    bounded = ["workspace={vx=[-1.0,1.0],vy=[-1.0,1.0],vz=[-1.0,1.0]}"]
    bounded_report = check(load("disturbance-gap", bounded))
    assert bounded_report.formula.corrected > bounded_report.formula.eta > 0.5
