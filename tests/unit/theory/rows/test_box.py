"""The QP in a box with one row against an exact solver, against OSQP, and at its edges."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from phalanx.theory.models.polytope import Polytope, extremes, polytope
from phalanx.theory.rows.qp import NearestInput, nearest_in_box
from phalanx.theory.rows.row import Row
from tests.unit.theory.rows.test_qp import nearest_by_active_sets

seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, m: int) -> tuple[np.random.Generator, Polytope, np.ndarray, np.ndarray]:
    """A generator, a box, weights, and a nominal input that is often outside of it."""
    rng = np.random.default_rng(seed)
    ends = np.sort(rng.uniform(-3, 3, (2, m)), axis=0)
    box = polytope(np.vstack([np.eye(m), -np.eye(m)]), np.concatenate([ends[1], -ends[0]]))
    return rng, box, rng.uniform(0.05, 2.0, m), rng.uniform(-6, 6, m)


def normal(rng: np.random.Generator, m: int, log_size: float) -> np.ndarray:
    """A row's normal, with a zero in it now and then."""
    return rng.normal(size=m) * (rng.uniform(size=m) < 0.8) * 10.0**log_size


def nearest(u_nom, weights, box, a, bound) -> list[float] | None:
    low, high = box.box.low.tolist(), box.box.high.tolist()
    return nearest_in_box(u_nom.tolist(), weights.tolist(), low, high, a.tolist(), bound, 1e-6)


@pytest.mark.slow
@given(seed=seeds, m=st.integers(1, 3), log_size=st.floats(-6, 3), share=st.floats(0.0, 1.2))
@settings(max_examples=100)
def test_it_finds_the_nearest_input_that_satisfies_the_row(seed, m, log_size, share):
    rng, box, weights, u_nom = drawn(seed, m)
    a = normal(rng, m, log_size)
    least, most = extremes(a, box.corners)
    bound = least + share * (most - least)
    u = nearest(u_nom, weights, box, a, bound)
    A, b = (box.A, box.b) if not a.any() else (np.vstack([box.A, a]), np.append(box.b, bound))
    assert u == pytest.approx(nearest_by_active_sets(u_nom, weights, A, b), abs=1e-8)
    assert a @ u - bound <= 1e-9 * np.abs(a).sum()


@pytest.mark.slow
@given(seed=seeds, m=st.integers(1, 3), share=st.floats(0.01, 0.9))
@settings(max_examples=50)
def test_it_answers_as_osqp_does(seed, m, share):
    """A polytope that is not known to be a box is for OSQP, which gives up now and then."""
    rng, box, weights, u_nom = drawn(seed, m)
    a = rng.normal(size=m)
    least, most = extremes(a, box.corners)
    row = Row(a, least + share * (most - least))
    qp = NearestInput(tuple(weights), most_steps=2000)
    other = qp.solve(u_nom, box._replace(box=None), row)
    assume(other is not None)
    assert qp.solve(u_nom, box, row) == pytest.approx(other, abs=2e-5)


@given(seed=seeds, m=st.integers(1, 3), gap=st.floats(1e-3, 3.0))
def test_a_row_that_no_input_keeps_has_no_answer(seed, m, gap):
    rng, box, weights, u_nom = drawn(seed, m)
    a = rng.normal(size=m)
    least, _ = extremes(a, box.corners)
    assert nearest(u_nom, weights, box, a, least - gap) is None


@pytest.mark.slow
@given(seed=seeds, m=st.integers(1, 3))
def test_a_row_that_one_corner_keeps_but_for_rounding_is_answered_by_that_corner(seed, m):
    rng, box, weights, u_nom = drawn(seed, m)
    a = rng.normal(size=m)
    least, _ = extremes(a, box.corners)
    u = nearest(u_nom, weights, box, a, least - 1e-12)
    assert u == pytest.approx(np.where(a > 0, box.box.low, box.box.high), abs=1e-9)


@pytest.mark.parametrize("bound", [np.inf, 0.0, -np.inf])
def test_a_bound_that_is_not_finite_is_kept_by_every_input_or_by_none(bound):
    _, box, weights, u_nom = drawn(0, 3)
    u = nearest(u_nom, weights, box, np.zeros(3), bound)
    assert (u is None) is (bound == -np.inf)
    if u is not None:
        assert (u == np.clip(u_nom, box.box.low, box.box.high)).all()
