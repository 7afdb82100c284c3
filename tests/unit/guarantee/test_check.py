"""What a check says of the shipped scenarios, against hand calculations and actual runs."""

import math

import numpy as np
import pytest

from phalanx.guarantee.check import check
from phalanx.guarantee.feasibility import rows_at_start
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.margins.constants import constants, margin_constants
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation

GUARANTEED, PAPER = check(load("guaranteed")), check(load("unicycles"))


def test_the_guaranteed_scenario_may_be_guaranteed_and_simulation_1_as_printed_may_not():
    assert GUARANTEED.may_be_guaranteed
    assert not PAPER.may_be_guaranteed
    assert any("η is given" in gap for gap in PAPER.gaps)


def test_the_relative_degree_and_the_start_are_those_of_the_chain():
    report = check(load("disturbance-gap"))
    assert report.relative_degree == 2
    assert report.worst_at_start == pytest.approx(max(25 - 81, 9.8 + 1.5 * (25 - 81)))


def test_a_start_outside_s_is_reported():
    report = check(load("pinned", ["agents.1.start=[[0.0, -0.9]]"]))
    assert report.worst_at_start > 0
    assert not report.may_be_guaranteed
    assert any("outside S_I" in word for word in report.words)


def test_the_papers_margin_is_far_below_its_own_formula():
    assert PAPER.eta_paper == dict.fromkeys("123", 8.0566)
    assert PAPER.formula.eta > 500
    assert any("a choice, not a bound" in word for word in PAPER.words)


def test_the_worst_pair_needs_a_smaller_margin_than_all_pairs_composed_and_it_is_proven():
    assert PAPER.pair_formula.proven
    assert not PAPER.formula.proven
    assert PAPER.pair_formula.eta < PAPER.formula.eta / 2


def test_theorem_4_is_refuted_for_simulation_1():
    """At d = 1 the best heading leaves about -8 + 4 + 8.06 > 0."""
    assert PAPER.theorem_4.holds is False
    assert PAPER.theorem_4.worst > 0


def test_the_constants_of_one_pair_are_the_hand_calculation_and_proven():
    """Single integrators: L_g h = -2 D, so c_g = 2 ‖I, -I‖ = 4, and c_h = sup 2 ‖D‖."""
    members = [Member("a", SingleIntegrator(1.0), False), Member("b", SingleIntegrator(2.0), True)]
    chain = build_chain(compose(members, [], Separation(1.0), 1.0), [1.5])
    low, high = np.full(4, -3.0), np.full(4, 3.0)
    found = constants(chain, low, high, [0.1, 0.2], np.zeros((1, 4)))
    assert all(constant.how == "interval" for constant in found.values())
    assert found["c_f"].value == 0.0
    assert found["c_g"].value == pytest.approx(4.0)
    assert found["c_h"].value == pytest.approx(2 * math.hypot(6, 6))
    assert found["u_max"].value == pytest.approx(math.sqrt(2))
    assert found["c_gamma"].value == pytest.approx(2 * math.hypot(2, 2) * math.sqrt(2))
    assert found["c_alpha"].value == pytest.approx(1.5 * 2 * math.hypot(6, 6) * math.sqrt(2))
    speeds = math.sqrt(2) + 0.1, 2 * math.sqrt(2) + 0.2
    assert found["mu"].value == pytest.approx(math.hypot(*speeds))
    eta = margin_constants(found).eta(0.01, 0.3)
    assert eta > found["c_h"].value * 0.3


def test_beyond_the_largest_gap_the_start_has_no_solution_and_below_it_has():
    gap = GUARANTEED.largest_gap
    assert gap > 0.012
    for factor, holds in ((0.8, True), (1.3, False)):
        period = f"agents.0.clock.period={gap * factor - 0.002}"
        swarm = build_swarm(load("guaranteed", [period]))
        assert all(rows_at_start(swarm).values()) is holds


def test_the_largest_gap_does_not_grow_with_a_margin_that_proves_less():
    scaled = check(load("guaranteed", ["safety.margin_scale=0.5"]))
    assert scaled.largest_gap == GUARANTEED.largest_gap


def test_only_the_printed_information_model_minds_delay():
    assert PAPER.largest_delay == 0.0
    assert GUARANTEED.largest_delay == math.inf


def test_one_controller_minds_no_delay_and_has_a_solution_where_single_agents_have_none():
    central = check(load("unicycles", ["safety.control=centralised"]))
    assert central.largest_delay == math.inf
    assert not PAPER.rows_at_start["3"]
    assert all(central.rows_at_start.values())
    assert any("sample together" in gap for gap in central.gaps)
    together = [f"agents.{g}.clock.jitter=0.0" for g in (0, 1)]
    synchronous = check(load("unicycles", ["safety.control=centralised", *together]))
    assert not any("sample together" in gap for gap in synchronous.gaps)


def test_states_without_known_bounds_are_asked_for_by_name():
    report = check(load("disturbance-gap"))
    assert report.formula is None
    assert any("vx, vy, vz in [workspace]" in word for word in report.words)
    bounded = ["workspace={vx=[-1.0,1.0],vy=[-1.0,1.0],vz=[-1.0,1.0]}"]
    known = check(load("disturbance-gap", bounded))
    assert known.formula.corrected > known.formula.eta > 0.5
