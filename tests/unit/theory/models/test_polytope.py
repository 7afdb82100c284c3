"""γ^min, γ^max, u^min, u^max of Eqs. (vLPs), (LPvminmax), (umin), against a linear program."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.polytope import (
    ACTUATION,
    EmptyPolytopeError,
    constant_polytope,
    extremes,
    maximiser,
    minimiser,
    polytope,
    vertices,
)
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import build_chain
from tests.unit.theory.polytopes import random_polytope
from tests.unit.theory.users_own import Drifter, OutputUnicycle, Rail, swarm_of
from tests.unit.theory.whole_expression import TermsFunction

seeds = st.integers(0, 2**32 - 1)


def program(c: np.ndarray, A: np.ndarray, b: np.ndarray) -> float:
    """min cᵀu by a linear program, its numbers scaled to what HiGHS likes."""
    size, rows = np.linalg.norm(c), np.linalg.norm(A, axis=1)
    solution = linprog(c / size, A_ub=A / rows[:, None], b_ub=b / rows, bounds=(None, None))
    assert solution.status == 0, solution.message
    return float(size * solution.fun)


@given(seed=seeds, m=st.integers(1, 3))
def test_extremes_and_their_points_are_those_of_the_linear_program(seed, m):
    rng = np.random.default_rng(seed)
    A, b = random_polytope(rng, m)
    c, corners = rng.normal(size=m) * 10.0 ** rng.uniform(-3, 3), vertices(A, b)
    least, most = program(c, A, b), -program(-c, A, b)
    near = {"rel": 1e-6, "abs": 1e-6 * np.abs(c).max()}
    assert extremes(c, corners) == pytest.approx((least, most), **near)
    assert c @ minimiser(c, corners) == pytest.approx(least, **near)
    assert c @ maximiser(c, corners) == pytest.approx(most, **near)


@given(seed=seeds, m=st.integers(1, 3))
def test_every_vertex_lies_in_the_polytope_on_as_many_rows_as_there_are_inputs(seed, m):
    A, b = random_polytope(np.random.default_rng(seed), m)
    size = np.linalg.norm(A, axis=1)
    for corner in vertices(A, b):
        slack = (b - A @ corner) / size
        assert slack.min() > -1e-7
        assert np.sum(slack < 1e-7) >= m


@given(seed=seeds, m=st.integers(1, 3))
def test_an_axis_aligned_polytope_knows_that_it_is_a_box_and_a_cut_one_that_it_is_not(seed, m):
    rng = np.random.default_rng(seed)
    low = rng.uniform(-3, 1, m)
    high = low + rng.uniform(0.1, 3, m)
    A, b = np.vstack([np.eye(m), -np.eye(m)]), np.concatenate([high, -low])
    box = polytope(A, b).box
    assert box is not None
    assert box.low == pytest.approx(low)
    assert box.high == pytest.approx(high)
    if m > 1:
        cut = polytope(np.vstack([A, np.ones(m)]), np.append(b, (low + high).sum() / 2))
        assert cut.box is None


EMPTY = {
    "contradiction": ([[1, 0], [-1, 0], [0, 1], [0, -1]], [-1, -1, 1, 1]),
    "three half-planes apart": ([[1, 0], [0, 1], [-1, -1]], [-1, -1, 1]),
    "on a line": ([[1], [-1]], [-2, 1]),
}
UNBOUNDED = {
    "half-plane": ([[1, 0]], [1]),
    "strip": ([[1, 0], [-1, 0]], [1, 1]),
    "quadrant": ([[1, 0], [0, 1]], [1, 1]),
    "half-strip": ([[1, 0], [-1, 0], [0, 1]], [1, 1, 1]),
    "slanted wedge": ([[1, 1], [1, -1]], [1, 1]),
    "ray": ([[1]], [1]),
    "prism": ([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1]], [1, 1, 1, 1, 1]),
}


@pytest.mark.parametrize("name", EMPTY | UNBOUNDED)
def test_an_empty_or_unbounded_polytope_is_refused(name):
    """Assumption (Ui): U_i is compact; otherwise γ^max does not exist."""
    A, b = (np.array(a, dtype=float) for a in (EMPTY | UNBOUNDED)[name])
    with pytest.raises(EmptyPolytopeError):
        polytope(A, b)


def paper_polytope(theta: float, speed: float, turn: float, b: float) -> tuple:
    """Eq. (IOcontrolbounds)."""
    cos, sin = np.cos(theta), np.sin(theta)
    A = [[cos, sin], [-cos, -sin], [-sin / b, cos / b], [sin / b, -cos / b]]
    return np.array(A), np.array([speed, speed, turn, turn])


@pytest.fixture(scope="module")
def mixed() -> TermsFunction:
    dynamics = [OutputUnicycle(), Drifter(), Unicycle(3.0, 1.5), OutputUnicycle(2.0, 1.0)]
    return TermsFunction(build_chain(swarm_of(dynamics).composed, [1.0]))


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=12)
def test_terms_have_the_extremes_of_every_members_own_polytope_at_this_state(mixed, seed):
    x = np.random.default_rng(seed).uniform(-2, 2, 12)
    terms = mixed(x)
    native = (np.vstack([np.eye(2), -np.eye(2)]), np.array([3.0, 1.5, 3.0, 1.5]))
    triangle = (np.array([[-1, 0], [0, -1], [1, 1]]), np.array([1, 1, 2.0 + np.tanh(x[3])]))
    expected = [
        paper_polytope(x[2], 4.0, 2.0, 0.25),
        triangle,
        native,
        paper_polytope(x[11], 2.0, 1.0, 0.25),
    ]
    for l, (A, b) in enumerate(expected):
        c = terms.c[l]
        u_set = terms.polytopes[l]
        sizes = np.linalg.norm(A, axis=1)
        assert np.allclose(u_set.A, A / sizes[:, None])
        assert np.allclose(u_set.b, b / sizes)
        assert terms.least[l] == pytest.approx(program(c, A, b), rel=1e-6, abs=1e-7)
        assert terms.most[l] == pytest.approx(-program(-c, A, b), rel=1e-6, abs=1e-7)


@pytest.fixture(scope="module")
def carts() -> TermsFunction:
    case = swarm_of([Rail(), Rail()], adversaries=0, obstacles=())
    return TermsFunction(build_chain(case.composed, [1.0]))


@given(seed=seeds)
@settings(max_examples=10)
def test_a_single_input_may_have_a_polytope_that_depends_on_the_state(carts, seed):
    x = np.random.default_rng(seed).uniform(-2, 2, 4)
    terms = carts(x)
    bounds = 1.0 / (1.0 + x[::2] ** 2)
    assert list(terms.most.values()) == pytest.approx(
        [abs(terms.c[l][0]) * b for l, b in enumerate(bounds)]
    )
    assert terms.least == pytest.approx({l: -most for l, most in terms.most.items()})


def test_a_polytope_that_becomes_empty_at_some_state_is_refused_there():
    """The triangle {u_1 >= -1, u_2 >= -1, u_1 + u_2 <= t + tanh x} is empty for small t."""
    case = swarm_of([Drifter(thrust=-2.0), Drifter()])
    terms = TermsFunction(build_chain(case.composed, [1.0]))
    terms(np.array([3.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(EmptyPolytopeError):
        terms(np.array([-3.0, 0.0, 0.0, 0.0, 0.0, 0.0]))


def test_an_empty_constant_polytope_is_refused_when_the_chain_is_compiled():
    case = swarm_of([SingleIntegrator(-1.0), SingleIntegrator(1.0)])
    with pytest.raises(EmptyPolytopeError):
        TermsFunction(build_chain(case.composed, [1.0]))


@given(seed=seeds, m=st.integers(1, 3))
@settings(max_examples=60, deadline=None)
def test_what_the_allowance_admits_is_within_reach_of_the_polytope(seed, m):
    """Distance is convex, so the vertices of what is admitted are the farthest."""
    rng = np.random.default_rng(seed)
    u_set = polytope(*random_polytope(rng, m))
    admitted = vertices(u_set.A, u_set.b + u_set.allowance)
    farthest = np.linalg.norm(admitted[:, None] - u_set.corners, axis=2).min(axis=1).max()
    assert 0.0 < farthest <= ACTUATION
    assert u_set.allowance <= ACTUATION


def test_a_box_is_allowed_what_its_corner_may_move():
    box = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    assert box.allowance == pytest.approx(ACTUATION / np.sqrt(2), rel=0.02)


def test_a_needle_is_allowed_no_more_than_its_point_may_move():
    """Beyond a corner of angle a, s above both rows is s / sin(a / 2) away."""
    for angle in (1e-1, 1e-3, 1e-5):
        sin, cos = np.sin(angle / 2), np.cos(angle / 2)
        rows = np.array([[sin, cos], [sin, -cos], [-1.0, 0.0]])
        needle = polytope(rows, np.array([0.0, 0.0, 1.0]))
        assert 0.5 * ACTUATION * sin <= needle.allowance <= ACTUATION * sin
        assert [needle.takes((off * ACTUATION, 0.0)) for off in (-1e5, 0.4, 1.1)] == [1, 1, 0]


def test_a_polytope_of_numbers_is_found_once_and_is_read_only():
    faces = ca.SX([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    u_set = constant_polytope(faces, ca.SX([2.0, 2.0, 3.0, 3.0]))
    assert u_set is constant_polytope(faces, ca.SX([2.0, 2.0, 3.0, 3.0]))
    assert u_set is constant_polytope(np.array(ca.DM(faces)), np.array([2.0, 2.0, 3.0, 3.0]))
    assert u_set.corners.max() == 3.0
    for array in (u_set.A, u_set.b, u_set.corners, minimiser(np.ones(2), u_set.corners)):
        with pytest.raises(ValueError, match="read-only"):
            array *= 0.5
