"""Decisions under several rows: the nearest input that keeps all, or the backup."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.models.polytope import polytope
from phalanx.theory.rows.decision import at_bound, decide_pairs
from phalanx.theory.rows.least_violation import least_violation
from phalanx.theory.rows.nearest_in_box import TOLERANCE
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows

seeds = st.integers(0, 2**32 - 1)


SQUARE = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))


@given(seed=seeds)
@settings(max_examples=60, deadline=None)
def test_the_qp_with_several_rows_keeps_them_all_and_is_nearest(seed):
    rng = np.random.default_rng(seed)
    inside = rng.uniform(-0.8, 0.8, 2)
    a = rng.normal(size=(3, 2))
    rows = Rows(a, a @ inside + rng.uniform(0.0, 0.3, 3))
    u_nom = rng.uniform(-2, 2, 2)
    decision = decide_pairs(SQUARE, rows, u_nom, NearestInput((1.0, 1.0)))
    assert decision.origin is Origin.QP
    sizes = np.linalg.norm(a, axis=1)
    assert ((a @ decision.u - rows.bound) / sizes <= 2 * TOLERANCE).all()
    # u is the projection of u_nom onto a convex set: no point of the set lies beyond it.
    others = rng.uniform(-1, 1, (400, 2))
    feasible = others[(others @ a.T <= rows.bound).all(axis=1)]
    assert ((feasible - decision.u) @ (u_nom - decision.u) <= 1e-4).all()


def test_an_input_is_at_a_bound_within_a_millionth_of_it_or_of_1():
    rows = Rows(np.ones((5, 2)), np.array([0.0, 0.0, -3.0, -3.0, np.nan]), others=(4, 5, 6, 7, 8))
    off = np.array([-9e-7, -1.1e-6, -3.9e-6, -4.1e-6, np.nan])
    assert at_bound(rows, off) == (4, 6, 8)


@given(seed=seeds)
@settings(max_examples=40, deadline=None)
def test_with_no_solution_the_backup_has_the_least_worst_violation(seed):
    rng = np.random.default_rng(seed)
    a = rng.normal(size=(3, 2))
    rows = Rows(a, (a @ SQUARE.corners.T).min(axis=1) - rng.uniform(0.1, 1.0, 3))
    decision = decide_pairs(SQUARE, rows, np.zeros(2), NearestInput((1.0, 1.0)))
    assert decision.origin is Origin.BACKUP
    others = rng.uniform(-1, 1, (400, 2))
    assert decision.residual <= ((others @ a.T) - rows.bound).max(axis=1).min() + 1e-9


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=100, deadline=None)
def test_where_a_margin_is_unknown_no_input_keeps_the_row_and_the_backup_goes_against_it(seed):
    """Its residual would be infinite: there is none."""
    rng = np.random.default_rng(seed)
    rows = Rows(rng.normal(size=(6, 2)) * 10, rng.uniform(-40, 40, 6))
    rows.bound[:2] = -np.inf
    decision = decide_pairs(SQUARE, rows, np.zeros(2), NearestInput((1.0, 1.0)))
    assert (decision.origin, decision.residual) == (Origin.BACKUP, None)
    others = rng.uniform(-1, 1, (50, 2))
    best = (others @ rows.a[:2].T).max(axis=1).min()
    assert (rows.a[:2] @ decision.u).max() <= best + 1e-9


def test_a_set_that_is_one_point_is_not_empty_and_one_that_misses_it_by_more_than_rounding_is():
    """Emptiness of K_i is decided by the QP itself: no second answer could differ."""
    corner = Rows(np.array([[1.0, 1.0], [-1.0, -1.0]]), np.array([-2.0, 2.0]))
    decision = decide_pairs(SQUARE, corner, np.zeros(2), NearestInput((1.0, 1.0)))
    assert decision.origin is Origin.QP
    assert decision.u == pytest.approx([-1.0, -1.0], abs=1e-8)
    beyond = Rows(corner.a, corner.bound - [1e-7, 0.0])
    decision = decide_pairs(SQUARE, beyond, np.zeros(2), NearestInput((1.0, 1.0)))
    assert decision.origin is Origin.BACKUP
    assert decision.u == pytest.approx([-1.0, -1.0])


def test_where_no_pair_is_near_the_nominal_input_is_applied_and_every_number_is_finite():
    rows = Rows(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([np.inf, np.inf]))
    u_nom = np.array([0.3, -0.2])
    decision = decide_pairs(SQUARE, rows, u_nom, NearestInput((1.0, 1.0)))
    assert decision.u == pytest.approx(u_nom)
    assert np.isfinite(decision.residual)
    assert decision.margin is None


def test_the_margin_reported_is_that_of_the_row_nearest_to_binding():
    rows = Rows(np.eye(2), np.array([0.9, 0.1]), np.array([7.0, 8.0]))
    decision = decide_pairs(SQUARE, rows, np.zeros(2), NearestInput((1.0, 1.0)))
    assert (decision.residual, decision.margin) == (-0.1, 8.0)
    unknown = Rows(np.eye(2), np.array([0.9, -np.inf]), np.array([7.0, np.inf]))
    decision = decide_pairs(SQUARE, unknown, np.zeros(2), NearestInput((1.0, 1.0)))
    assert (decision.residual, decision.margin) == (None, None)


def test_the_backup_ignores_pairs_outside_the_neighbourhood():
    rows = Rows(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([-5.0, np.inf]))
    assert least_violation(SQUARE, rows)[0] == pytest.approx(-1.0)


@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize("size", [1.0, 1e100, 1e160, 1e300])
def test_a_row_too_large_for_float64_is_not_dropped(size, capfd):
    """The square of its length overflows from 1e154 on: then the backup keeps it."""
    rows = Rows(np.array([[size, size], [0.0, 1.0]]), np.array([-1.0, 0.5]))
    u = decide_pairs(SQUARE, rows, np.array([0.9, 0.9]), NearestInput((1.0, 1.0))).u
    assert u[0] + u[1] <= -1.0 / size + 3 * TOLERANCE
    assert u[1] <= 0.5 + TOLERANCE
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("size", [np.nan, np.inf])
def test_a_row_that_is_not_a_number_reaches_no_solver(size, capfd):
    """OSQP prints an error of it, whatever its settings."""
    rows = Rows(np.array([[size, 1.0], [0.0, 1.0]]), np.array([-1.0, 0.5]))
    assert NearestInput((1.0, 1.0)).solve(np.array([0.9, 0.9]), SQUARE, rows) is None
    assert capfd.readouterr() == ("", "")


def test_where_no_vertex_is_found_in_float64_the_best_corner_of_u_is_taken():
    rows = Rows(np.array([[-6e68, -1e69]]), np.array([0.0]))
    assert least_violation(SQUARE, rows).tolist() == [1.0, 1.0]
