"""Rows of both information models, and what an agent makes of them."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.polytope import maximiser, minimiser
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.rows.decision import NotANumberError, decide
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Row, joint_sum, paper_row, shares, split_row
from phalanx.theory.safety.chain import build_chain
from tests.unit.theory.users_own import Case, Drifter, OutputUnicycle, Oval, along, swarm_of
from tests.unit.theory.whole_expression import TermsFunction

ALPHA, ETA = 1.3, 0.8
NORMAL, ADVERSARIES = (0, 1, 2), (3, 4)
seeds = st.integers(0, 2**32 - 1)


@cache
def swarm() -> Case:
    dynamics = [Unicycle(4.0, 2.0), Drifter(), SingleIntegrator(1.5)]
    attackers = [OutputUnicycle(), Unicycle(2.0, 1.0)]
    return swarm_of([*dynamics, *attackers], adversaries=2, function=Oval())


@cache
def terms_function() -> TermsFunction:
    return TermsFunction(build_chain(swarm().composed, [ALPHA]), margin=ETA)


def joint_condition(x: np.ndarray, u: dict[int, np.ndarray]) -> float:
    """Left-hand side of Eq. (KNx), with ḣ_tot by finite differences and adversaries at worst."""
    twin, terms = swarm().twin, terms_function()(x)
    u = u | {j: maximiser(terms.c[j], terms.polytopes[j].corners) for j in ADVERSARIES}
    rate = sum(twin.f(l, x) + twin.g(l, x) @ u[l] for l in range(5))
    return along(twin.h_tot, x, rate) + ALPHA * twin.h_tot(x) + ETA


def draw_state(seed: int) -> tuple[np.random.Generator, np.ndarray, dict[int, np.ndarray]]:
    rng = np.random.default_rng(seed)
    x = rng.uniform(-2.5, 2.5, swarm().composed.x.numel())
    polytopes = terms_function()(x).polytopes
    inputs = {}
    for l in NORMAL:
        corners = polytopes[l].corners
        inputs[l] = rng.dirichlet(np.ones(len(corners))) @ corners
    return rng, x, inputs


@pytest.mark.slow
@given(seed=seeds, i=st.sampled_from(NORMAL), silent=st.sampled_from(NORMAL))
def test_the_papers_row_is_the_joint_condition_with_who_was_not_heard_at_its_worst(seed, i, silent):
    """All are heard where it is agent i itself that is silent."""
    _, x, u = draw_state(seed)
    terms = terms_function()(x)
    heard = {l: u[l] for l in NORMAL if l not in (i, silent)}
    worst = u | {l: maximiser(terms.c[l], terms.polytopes[l].corners) for l in {silent} - {i}}
    row = paper_row(terms, i, heard)
    assert row.a @ u[i] - row.bound == pytest.approx(joint_condition(x, worst), rel=1e-4, abs=1e-4)


@pytest.mark.slow
@given(seed=seeds)
def test_shares_of_all_normal_agents_add_up_to_the_joint_condition(seed):
    _, x, u = draw_state(seed)
    rows = {i: split_row(terms_function()(x), i, NORMAL) for i in NORMAL}
    shares = sum(rows[i].a @ u[i] - rows[i].bound for i in NORMAL)
    assert shares == pytest.approx(joint_condition(x, u), rel=1e-4, abs=1e-4)


def best_joint_condition(x: np.ndarray) -> float:
    """T: the joint condition when every normal agent does its best."""
    terms = terms_function()(x)
    best = {i: minimiser(terms.c[i], terms.polytopes[i].corners) for i in NORMAL}
    return joint_condition(x, best)


@pytest.mark.slow
@given(seed=seeds, offset=st.floats(-3, 3).filter(lambda o: abs(o) > 1e-3))
def test_shares_are_feasible_exactly_when_the_joint_condition_is(seed, offset):
    """η is chosen so that T = offset, on either side of zero."""
    _, x, _ = draw_state(seed)
    terms = terms_function()(x)
    eta = ETA - best_joint_condition(x) + offset
    for i in NORMAL:
        feasible = terms.least[i] <= split_row(terms._replace(margin=eta), i, NORMAL).bound
        assert feasible == (offset <= 0)


@pytest.mark.slow
@given(seed=seeds)
def test_shares_are_positive_and_sum_to_one_and_go_by_what_an_agent_can_do(seed):
    terms = terms_function()(draw_state(seed)[1])
    by_agent = shares(terms, NORMAL)
    spans = [terms.most[l] - terms.least[l] for l in NORMAL]
    assert (by_agent > 0.0).all()
    assert by_agent.sum() == pytest.approx(1.0)
    assert (np.argsort(by_agent) == np.argsort(spans)).all()
    idle = terms._replace(least=terms.most)  # no agent has any authority
    assert shares(idle, NORMAL) == pytest.approx([1.0 / 3.0] * 3)
    bounds = [split_row(terms, i, NORMAL).bound - terms.least[i] for i in NORMAL]
    assert sum(bounds) == pytest.approx(-joint_sum(terms, NORMAL))


def solver(i: int) -> NearestInput:
    return NearestInput(swarm().composed.members[i].dynamics.input_metric())


@pytest.mark.slow
@given(seed=seeds, i=st.sampled_from(NORMAL), share=st.floats(0.01, 1.5))
def test_a_qp_input_is_in_the_safety_preserving_set(seed, i, share):
    rng, x, _ = draw_state(seed)
    terms = terms_function()(x)
    row = Row(terms.c[i], terms.least[i] + share * (terms.most[i] - terms.least[i]))
    polytope = terms.polytopes[i]
    u_nom = rng.uniform(-9, 9, 2)
    decision = decide(terms, i, row, u_nom, solver(i), 0.0)
    assert decision.origin == Origin.QP
    assert (polytope.A @ decision.u <= polytope.b + 1e-5).all()
    assert row.a @ decision.u <= row.bound + 2e-6 * max(1.0, np.linalg.norm(row.a))
    assert decision.residual == pytest.approx(row.a @ decision.u - row.bound)


@pytest.mark.slow
@given(seed=seeds, i=st.sampled_from(NORMAL), gap=st.floats(0.01, 5.0))
def test_without_solution_the_agent_does_what_helps_most(seed, i, gap):
    rng, x, _ = draw_state(seed)
    terms = terms_function()(x)
    row = Row(terms.c[i], terms.least[i] - gap)
    polytope = terms.polytopes[i]
    decision = decide(terms, i, row, rng.uniform(-9, 9, 2), solver(i), 0.0)
    assert decision.origin == Origin.BACKUP
    assert terms.c[i] @ decision.u == pytest.approx(terms.least[i])
    assert (polytope.A @ decision.u <= polytope.b + 1e-8).all()
    assert decision.residual == pytest.approx(gap)


def test_a_row_that_is_no_number_is_an_error_and_no_reason_to_back_up():
    terms = terms_function()(draw_state(0)[1])
    with pytest.raises(NotANumberError):
        decide(terms, 0, Row(terms.c[0], np.nan), np.zeros(2), solver(0), 0.0)


@pytest.mark.slow
@given(seed=seeds, i=st.sampled_from(NORMAL))
def test_an_agent_that_cannot_help_goes_on_as_it_wants_within_its_bounds(seed, i):
    rng, x, _ = draw_state(seed)
    terms = terms_function()(x)
    span = terms.most[i] - terms.least[i]
    row, polytope = Row(terms.c[i], terms.least[i] - 1.0), terms.polytopes[i]
    u_nom = rng.uniform(-9, 9, 2)
    decision = decide(terms, i, row, u_nom, solver(i), 1.001 * span)
    assert decision.origin == Origin.NO_AUTHORITY
    projected = solver(i).solve(u_nom, polytope)
    assert projected is not None
    assert decision.u == pytest.approx(projected)
    busier = decide(terms, i, row, u_nom, solver(i), 0.999 * span)
    assert busier.origin == Origin.BACKUP
