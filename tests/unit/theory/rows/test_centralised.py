"""Theorem 1: one QP for all normal agents."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import Swarm
from phalanx.theory.rows.centralised import JointInput, joint_row
from phalanx.theory.rows.origin import Origin
from tests.unit.swarms import rows_of_scenario, swarm_of_scenario
from tests.unit.theory.whole_expression import TermsFunction


@pytest.fixture(scope="module")
def swarm() -> Swarm:
    return swarm_of_scenario("unicycles")


@pytest.fixture(scope="module")
def qp(swarm: Swarm) -> JointInput:
    return JointInput([swarm.members[l].dynamics for l in swarm.normal])


@cache
def all_terms() -> TermsFunction:
    """Terms of all pairs, for the one controller."""
    return TermsFunction(rows_of_scenario("unicycles").chain)


@pytest.mark.slow
@given(seed=st.integers(0, 2**32 - 1), least=st.floats(-30.0, 5.0).filter(lambda v: abs(v) > 1e-6))
@settings(max_examples=60, deadline=None)
def test_the_joint_input_keeps_the_condition_of_theorem_1_whenever_any_input_does(
    swarm, qp, seed, least
):
    """η is chosen so that the best joint effort leaves `least`, on either side of zero."""
    rng = np.random.default_rng(seed)
    x = swarm.start() + rng.uniform(-3, 3, 15)
    terms, normal = all_terms()(x), swarm.normal
    nominal = [rng.uniform(-5, 5, 2) for _ in normal]
    others = terms.unforced + sum(terms.most[l] for l in (3, 4))
    eta = least - others - sum(terms.least[l] for l in normal)
    decisions = qp.decide(terms._replace(margin=eta), normal, nominal)
    joint, possible = others + eta, least <= 0
    forced = sum(float(terms.c[l] @ d.u) for l, d in zip(normal, decisions, strict=True))
    assert (decisions[0].origin in (Origin.QP, Origin.SOLVER_FAILED)) == possible
    if possible:
        assert joint + forced <= 1e-4
        assert decisions[0].residual == pytest.approx(joint + forced, abs=1e-6)
    else:
        least = sum(terms.least[l] for l in normal)
        assert forced == pytest.approx(least, abs=0.01 * len(normal)), "without authority"


def test_it_changes_the_nominal_inputs_no_more_than_needed(swarm, qp):
    """Nominal inputs that keep the condition are applied."""
    terms, normal = all_terms()(swarm.start()), swarm.normal
    nominal = [np.array([0.3, -0.1]), np.array([0.0, 0.2]), np.array([1.0, 0.0])]
    row = joint_row(terms, normal)
    assert row.a @ np.concatenate(nominal) <= row.bound
    for decision, u_nom in zip(qp.decide(terms, normal, nominal), nominal, strict=True):
        assert decision.u == pytest.approx(u_nom)


def test_without_a_solution_an_agent_without_authority_keeps_its_nominal_input(swarm, qp):
    terms, normal = all_terms()(swarm.start()), swarm.normal
    spans = (0.0, 5.0, 5.0, 0.0, 0.0)
    most = {l: terms.least[l] + span for l, span in enumerate(spans)}
    weak = terms._replace(most=most, unforced=1e3)
    nominal = [np.array([0.3, -0.1]), np.array([0.0, 0.2]), np.array([1.0, 0.0])]
    decisions = qp.decide(weak, normal, nominal)
    assert [d.origin for d in decisions] == [Origin.NO_AUTHORITY, Origin.BACKUP, Origin.BACKUP]
    assert decisions[0].u == pytest.approx(nominal[0])


def test_pairs_and_a_central_controller_exclude_each_other():
    with pytest.raises(ScenarioError, match=r"safety\.composition: expected 'lse'"):
        load("guaranteed", ["safety.control=centralised"])


def test_the_one_controller_composes_what_no_agent_sees_alone():
    near, all_ = ["safety.neighbourhood=1.0"], ["safety.control=centralised"]
    alone, together = (
        rows_of_scenario("unicycles", *overrides) for overrides in (near, near + all_)
    )
    x = alone.swarm.start()
    assert together.terms(0)(x).psi == pytest.approx(all_terms()(x).psi)
    assert alone.terms(0)(x, alone.swarm.seen(0, x)).psi < all_terms()(x).psi
