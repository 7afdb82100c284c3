"""The agent's QP, in any polytope and in a box, against an exact solver that tries all rows."""

import sys
from itertools import combinations

import numpy as np
import osqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.models.polytope import ACTUATION, Polytope, extremes, polytope, vertices
from phalanx.theory.rows.nearest_in_box import TOLERANCE, nearest_in_box
from phalanx.theory.rows.nearest_point import nearest_point, strictly_nearest
from phalanx.theory.rows.qp import ActiveRows, NearestInput
from phalanx.theory.rows.row import Row, Rows
from tests.unit.theory.polytopes import random_polytope

seeds = st.integers(0, 2**32 - 1)


def nearest_by_active_sets(u_nom, weights, A, b) -> np.ndarray | None:
    """The point of {A u <= b} nearest to u_nom in the metric: the only one that fulfils KKT."""
    size = np.linalg.norm(A, axis=1)
    A, b = A / size[:, None], b / size
    best, best_cost = None, np.inf
    for count in range(len(u_nom) + 1):
        for rows in map(list, combinations(range(len(b)), count)):
            B = A[rows] / weights
            if count and np.linalg.cond(B @ A[rows].T) > 1e10:
                continue
            u = u_nom - B.T @ np.linalg.solve(B @ A[rows].T, A[rows] @ u_nom - b[rows])
            cost = weights @ (u - u_nom) ** 2
            if (A @ u <= b + 1e-9).all() and cost < best_cost:
                best, best_cost = u, cost
    return best


def draw_problem(seed: int, m: int) -> tuple[np.random.Generator, Polytope, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    A, b = random_polytope(rng, m)
    unit = np.linalg.norm(A, axis=1)
    u_set = polytope(A / unit[:, None], b / unit)
    return rng, u_set, rng.uniform(0.05, 2.0, m), rng.uniform(-6, 6, m)


def cutting_row(rng: np.random.Generator, u_set: Polytope, size: float, share: float) -> Row:
    """A row of norm `size` that leaves that share of the polytope's width."""
    a = rng.normal(size=u_set.A.shape[1])
    a *= size / np.linalg.norm(a)
    least, most = extremes(a, u_set.corners)
    return Row(a, least + share * (most - least))


@pytest.mark.slow
@given(seed=seeds, m=st.integers(1, 3), log_size=st.floats(-6, 3), share=st.floats(0.02, 1.2))
@settings(max_examples=60)
def test_the_qp_finds_the_nearest_input_that_satisfies_the_row(seed, m, log_size, share):
    rng, u_set, weights, u_nom = draw_problem(seed, m)
    row = cutting_row(rng, u_set, 10.0**log_size, share)
    u = NearestInput(tuple(weights)).solve(u_nom, u_set, row)
    exact = nearest_by_active_sets(
        u_nom, weights, np.vstack([u_set.A, row.a]), np.append(u_set.b, row.bound)
    )
    assert u is not None
    assert exact is not None
    assert u == pytest.approx(exact, abs=1e-8)
    assert row.a @ u - row.bound <= TOLERANCE * np.linalg.norm(row.a) * 1.001
    assert (u_set.A @ u <= u_set.b + TOLERANCE).all()


@given(seed=seeds, m=st.integers(1, 3))
def test_without_a_row_the_qp_projects_onto_the_polytope(seed, m):
    _, u_set, weights, u_nom = draw_problem(seed, m)
    u = NearestInput(tuple(weights)).solve(u_nom, u_set)
    assert u == pytest.approx(nearest_by_active_sets(u_nom, weights, u_set.A, u_set.b), abs=1e-8)


@given(seed=seeds, m=st.integers(1, 3), log_size=st.floats(-6, 3), gap=st.floats(0.01, 3.0))
@settings(max_examples=40)
def test_an_infeasible_row_gives_none(seed, m, log_size, gap):
    rng, u_set, weights, u_nom = draw_problem(seed, m)
    row = cutting_row(rng, u_set, 10.0**log_size, -gap)
    assert NearestInput(tuple(weights)).solve(u_nom, u_set, row) is None


@pytest.mark.parametrize(("bound", "feasible"), [(0.0, True), (1.0, True), (-1e-9, False)])
def test_a_row_without_authority_holds_for_all_inputs_or_for_none(bound, feasible):
    u_set = polytope(np.array([[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]), np.ones(3))
    u = NearestInput((1.0, 1.0)).solve(np.zeros(2), u_set, Row(np.zeros(2), bound))
    assert (u is not None) is feasible


@pytest.mark.slow
@given(seed=seeds, m=st.integers(1, 3))
@settings(max_examples=15)
def test_a_solver_updated_many_times_answers_bit_for_bit_as_a_fresh_one(seed, m):
    """Adaptive ρ and warm starts would carry memory from one step into the next."""
    rng, u_set, weights, _ = draw_problem(seed, m)
    solver = NearestInput(tuple(weights))
    for _ in range(12):
        u_nom = rng.uniform(-9, 9, m)
        row = cutting_row(rng, u_set, 10.0 ** rng.uniform(-6, 3), rng.uniform(-0.3, 0.9))
        moved = polytope(u_set.A, u_set.b + rng.uniform(0, 1, len(u_set.b)))
        fresh = NearestInput(tuple(weights)).solve(u_nom, moved, row)
        again = solver.solve(u_nom, moved, row)
        assert (fresh is None) is (again is None)
        if fresh is not None and again is not None:
            assert again.tobytes() == fresh.tobytes()


@pytest.mark.slow
@given(seed=seeds)
@settings(max_examples=30)
def test_zeros_in_the_polytope_do_not_upset_the_kept_solver(seed):
    """A zero that vanished from the sparsity pattern would shift all coefficients after it."""
    rng, _, weights, _ = draw_problem(seed, 2)
    solver = NearestInput(tuple(weights))
    triangles = [[[-1, 0], [0, -1], [1, 1]], [[0.6, 0.8], [-1, 0.2], [0.1, -1]]]
    for A in triangles * 2:
        u_set, u_nom = polytope(np.array(A, dtype=float), np.ones(3)), rng.uniform(-4, 4, 2)
        row = cutting_row(rng, u_set, 1.0, 0.5)
        exact = nearest_by_active_sets(
            u_nom, weights, np.vstack([u_set.A, row.a]), np.append(u_set.b, row.bound)
        )
        assert solver.solve(u_nom, u_set, row) == pytest.approx(exact, abs=2e-5)


def test_an_answer_is_the_callers_to_keep():
    u_set = polytope(np.array([[1.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]), np.ones(3))
    qp = NearestInput((1.0, 1.0))
    first = qp.solve(np.array([5.0, 0.0]), u_set)
    assert first is not None
    before = first.copy()
    qp.solve(np.array([-5.0, -5.0]), u_set)
    assert (first == before).all()


def test_the_exact_solver_used_here_is_itself_right_on_a_known_answer():
    A, b = np.vstack([np.eye(2), -np.eye(2), [[1.0, 1.0]]]), np.array([1.0, 1, 1, 1, 1])
    u = nearest_by_active_sets(np.array([3.0, 3.0]), np.array([1.0, 1.0]), A, b)
    assert u == pytest.approx([0.5, 0.5])


BOX = polytope(np.vstack([np.eye(3), -np.eye(3)]), np.array([4.0, 2.0, 1.0, 4.0, 2.0, 1.0]))


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e3, 1e6, 1e9, 1e12])
def test_a_nominal_input_of_any_size_is_brought_to_the_nearest_one(size):
    """No point of the set lies beyond u in the direction of u_nom: that makes u the nearest."""
    rng, qp = np.random.default_rng(0), NearestInput((1.0, 1.0, 1.0))
    solved = 0
    for _ in range(200):
        row = cutting_row(rng, BOX, 3.0, rng.uniform(0.05, 0.6))
        towards = rng.normal(size=3)
        u_nom = size * towards / np.linalg.norm(towards)
        u = qp.solve(u_nom, BOX, row)
        if u is not None:
            solved += 1
            corners = vertices(np.vstack([BOX.A, row.a]), np.append(BOX.b, row.bound))
            away = (u_nom - u) / np.linalg.norm(u_nom - u)
            assert ((corners - u) @ away <= 1e-5).all()
    assert solved >= 190


@pytest.mark.parametrize("faces", [6, 7], ids=["box", "another polytope"])
@pytest.mark.parametrize("rows", [Row, lambda a, bound: Rows(a[None], np.array([bound]))])
def test_in_units_that_are_a_million_times_smaller_the_answer_is_the_same(faces, rows):
    A = np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.8, 0.0]]])[:faces]
    b, u_nom, answers = np.array([4.0, 2, 1, 0, 0, 0, 3])[:faces], np.array([3e7, 7e6, 2e6]), []
    for unit in (1.0, 2.0**20):
        row = rows(np.array([0.6, 0.0, 0.8]), unit * 1.5)
        solved = NearestInput((1.0, 2.0, 0.5)).solve(unit * u_nom, polytope(A, unit * b), row)
        answers.append(solved / unit)
    assert answers[1] == pytest.approx(answers[0], abs=1e-9)


@pytest.mark.parametrize("angle", [1.0, 1e-2, 1e-4])
def test_a_solution_at_a_sharp_corner_is_no_farther_out_than_an_actuator_admits(angle):
    """Two rows that meet at this angle: TOLERANCE outside both is far outside the corner."""
    A = np.array([[np.sin(angle / 2), np.cos(angle / 2)], [np.sin(angle / 2), -np.cos(angle / 2)]])
    needle = polytope(np.vstack([A, [[-1.0, 0.0]]]), np.array([0.0, 0.0, 1.0]))
    for towards in ([1.0, 0.0], [1e5, 3.0], [1.0, -1e-3]):
        u = NearestInput((1.0, 1.0)).solve(np.array(towards), needle)
        assert u is None or np.linalg.norm(u) <= ACTUATION or u[0] <= 0.0


def draw_box(seed: int, m: int) -> tuple[np.random.Generator, Polytope, np.ndarray, np.ndarray]:
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
def test_in_a_box_the_nearest_input_that_satisfies_the_row_is_exact(seed, m, log_size, share):
    rng, box, weights, u_nom = draw_box(seed, m)
    a = normal(rng, m, log_size)
    least, most = extremes(a, box.corners)
    bound = least + share * (most - least)
    u = nearest(u_nom, weights, box, a, bound)
    A, b = (box.A, box.b) if not a.any() else (np.vstack([box.A, a]), np.append(box.b, bound))
    assert u == pytest.approx(nearest_by_active_sets(u_nom, weights, A, b), abs=1e-8)
    assert a @ u - bound <= 1e-9 * np.abs(a).sum()


@given(seed=seeds, m=st.integers(1, 3), gap=st.floats(1e-3, 3.0))
def test_a_row_that_no_input_keeps_has_no_answer(seed, m, gap):
    rng, box, weights, u_nom = draw_box(seed, m)
    a = rng.normal(size=m)
    least, _ = extremes(a, box.corners)
    assert nearest(u_nom, weights, box, a, least - gap) is None


@pytest.mark.slow
@given(seed=seeds, m=st.integers(1, 3))
def test_a_row_that_one_corner_keeps_but_for_rounding_is_answered_by_that_corner(seed, m):
    rng, box, weights, u_nom = draw_box(seed, m)
    a = rng.normal(size=m)
    least, _ = extremes(a, box.corners)
    u = nearest(u_nom, weights, box, a, least - 1e-12)
    assert u == pytest.approx(np.where(a > 0, box.box.low, box.box.high), abs=1e-9)


@pytest.mark.parametrize("bound", [np.inf, 0.0, -np.inf])
def test_a_bound_that_is_not_finite_is_kept_by_every_input_or_by_none(bound):
    _, box, weights, u_nom = draw_box(0, 3)
    u = nearest(u_nom, weights, box, np.zeros(3), bound)
    assert (u is None) is (bound == -np.inf)
    if u is not None:
        assert (u == np.clip(u_nom, box.box.low, box.box.high)).all()


@pytest.mark.parametrize("m", [1, 2, 3])
def test_osqp_names_the_rows_that_bind_where_no_other_is_close(m):
    """A wrong guess changes no bits, so nothing else would notice."""
    rng, right = np.random.default_rng(m), 0
    osqps = ActiveRows(2 * m + 4, m)
    for _ in range(20):
        a = rng.normal(size=(4, m))
        G = np.vstack([np.eye(m), -np.eye(m), a / np.linalg.norm(a, axis=1)[:, None]])
        n, g = rng.normal(size=m) * 3.0, rng.uniform(0.3, 1.0, 2 * m + 4)
        guess = osqps.guess(n, G, g)
        right += strictly_nearest(n.tolist(), G, g, guess) == nearest_point(n.tolist(), G, g, 9.0)
    assert right >= 18


def test_there_is_one_compiled_part_for_all_imports() -> None:
    assert osqp.OSQP(algebra="builtin").ext is sys.modules["osqp.ext_builtin"]
