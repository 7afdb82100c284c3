"""The nearest point of a polyhedron: one answer to the last bit, whatever hints there are."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import osqp
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from phalanx.theory.rows import nearest_point as module
from phalanx.theory.rows.nearest_point import NearestPoint, nearest_point, strictly_nearest
from tests.unit.theory.rows.native_pieces import library_of, needs_a_compiler

Program = tuple[list[float], np.ndarray, np.ndarray, float]
"""n, G, g and the size of v, as nearest_point takes them."""
KINDS = ("random", "degenerate", "parallel", "almost parallel", "slab", "nearly empty", "empty")


def draw_program(kind: str, m: int, count: int, rng: np.random.Generator) -> Program:
    """n, unit rows and bounds: a box, and rows through or around one point of it."""
    a, point = rng.normal(size=(count, m)), rng.uniform(-0.5, 0.5, m)
    half = count // 2
    if kind == "parallel":
        a[half:] = a[: count - half] * rng.uniform(0.5, 2.0, (count - half, 1))
    if kind == "almost parallel":
        a[half:] = a[: count - half] + rng.normal(size=(count - half, m)) * 10 ** rng.uniform(
            -9, -3
        )
    if kind == "slab":
        a[half:] = -a[: count - half]
    slack = {
        "random": rng.uniform(0.0, 0.5, count),
        "degenerate": np.zeros(count),
        "nearly empty": -rng.choice([0.0, 1e-10, 1e-8, 1e-6], count),
        "empty": -rng.uniform(0.0, 0.5, count),
    }.get(kind, rng.choice([0.0, 1e-9, 1e-3, 0.1], count))
    sizes = np.linalg.norm(a, axis=1)
    G = np.vstack([np.eye(m), -np.eye(m), a / sizes[:, None]])
    g = np.concatenate([np.full(2 * m, rng.uniform(0.5, 2.0)), (a @ point + slack) / sizes])
    n = rng.normal(size=m) * rng.choice([0.5, 3.0, 1e3, 1e6])
    return n.tolist(), G, g, 4.0 * m


programs = st.builds(
    lambda kind, m, count, seed: draw_program(kind, m, count, np.random.default_rng(seed)),
    st.sampled_from(KINDS),
    st.integers(1, 3),
    st.integers(1, 8),
    st.integers(0, 2**32 - 1),
)


def first_of_all_sets(n, G, g) -> NearestPoint | None:
    """The definition: sets of all rows in order, by size and then by number."""
    for size in range(len(n) + 1):
        for rows in combinations(range(len(g)), size):
            if optimum := module._passing(n, G, g, rows):
                return NearestPoint(optimum.v, rows)
    return None


@pytest.mark.slow
@given(programs)
@settings(max_examples=150, deadline=None)
def test_the_answer_is_that_of_the_first_set_of_all_that_passes(program):
    n, G, g, size = program
    assert nearest_point(n, G, g, size) == first_of_all_sets(n, G, g)


@given(programs)
@settings(max_examples=60, deadline=None)
def test_a_hint_gives_the_same_bits_or_nothing(program):
    n, G, g, size = program
    answer = nearest_point(n, G, g, size)
    for count in range(len(n) + 1):
        for hint in combinations(range(len(g)), count):
            assert strictly_nearest(n, G, g, hint) in (None, answer)


def test_the_rows_of_an_answer_where_nothing_is_close_are_a_hint_that_is_enough(rng):
    n, G, g = [3.0, 0.2], np.vstack([np.eye(2), -np.eye(2)]), np.ones(4)
    assert strictly_nearest(n, G, g, (0,)) == nearest_point(n, G, g, 2.0) == ([1.0, 0.2], (0,))
    assert strictly_nearest(n, G, g, (0, 1)) is None


def test_of_sets_with_a_row_that_only_touches_the_smallest_is_the_answer():
    """The second row passes through the point, with a multiplier of zero."""
    G = np.array([[0.6, 0.8], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    g = np.array([0.6 * 1.0 + 0.8 * 0.5, 1.0, 1.0, 1.0, 1.0])
    assert module._passing([3.0, 0.5], G, g, (0, 1)) is not None
    assert nearest_point([3.0, 0.5], G, g, 2.0) == ([1.0, 0.5], (1,))
    assert strictly_nearest([3.0, 0.5], G, g, (0, 1)) is None


def exactly_nearest(n: list[float], G: np.ndarray, g: np.ndarray) -> list[Fraction] | None:
    """The same point in rational numbers, by trying all sets."""
    exact = [[Fraction(float(c)) for c in row] for row in G]
    bounds, start = [Fraction(float(b)) for b in g], [Fraction(x) for x in n]
    for size in range(len(n) + 1):
        for rows in combinations(range(len(g)), size):
            v = _projection(start, [exact[k] for k in rows], [bounds[k] for k in rows])
            if v is not None and all(
                sum(c * x for c, x in zip(a, v, strict=True)) <= b
                for a, b in zip(exact, bounds, strict=True)
            ):
                return v
    return None


def _projection(start, normals, bounds) -> list[Fraction] | None:
    """Gaussian elimination of G Gᵀ λ = G n - g; None if singular or a multiplier is negative."""
    products = [[sum(a * b for a, b in zip(p, q, strict=True)) for q in normals] for p in normals]
    table = [
        [*row, sum(c * x for c, x in zip(a, start, strict=True)) - bound]
        for row, a, bound in zip(products, normals, bounds, strict=True)
    ]
    for k in range(len(table)):
        if not (pivot := table[k][k]):
            return None
        table[k] = [value / pivot for value in table[k]]
        for j in range(len(table)):
            if j != k:
                factor = table[j][k]
                table[j] = [x - factor * y for x, y in zip(table[j], table[k], strict=True)]
    multipliers = [row[-1] for row in table]
    if any(multiplier < 0 for multiplier in multipliers):
        return None
    moves = [
        sum(l * a[c] for l, a in zip(multipliers, normals, strict=True)) for c in range(len(start))
    ]
    return [x - move for x, move in zip(start, moves, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["random", "parallel", "degenerate"])
@pytest.mark.parametrize("seed", range(15))
def test_the_answer_is_that_of_rational_arithmetic_to_its_last_digits(kind, seed):
    rng = np.random.default_rng(seed)
    n, G, g, size = draw_program(kind, 1 + seed % 3, 5, rng)
    answer, exact = nearest_point(n, G, g, size), exactly_nearest(n, G, g)
    if exact is None:  # rows through one point, of which rounding lets nothing
        exact = exactly_nearest(n, G, g + 1e-12)
    assert answer is not None
    assert exact is not None
    assert answer.v == pytest.approx(
        [float(x) for x in exact], abs=1e-6 if kind != "random" else 1e-9
    )


@pytest.mark.parametrize("m", [1, 2, 4, 8])
@pytest.mark.parametrize("count", [1, 6, 60])
def test_osqp_at_tight_tolerances_agrees(m, count):
    rng = np.random.default_rng(m * count)
    for _ in range(5):
        _, G, g, size = draw_program("random", m, count, rng)
        n = rng.normal(size=m) * 2.0
        solver = osqp.OSQP(algebra="builtin")
        options = {"eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 200_000, "verbose": False}
        low = np.full(len(g), -np.inf)
        solver.setup(sparse.eye(m, format="csc"), -n, sparse.csc_matrix(G), low, g, **options)
        answer = nearest_point(n.tolist(), G, g, size)
        assert answer is not None
        assert answer.v == pytest.approx(solver.solve(raise_error=True).x, abs=1e-6)


def test_where_more_sets_would_have_to_be_tried_the_iterations_answer_stands(monkeypatch, rng):
    """Rows through one point: of many, the set at which the iteration ends."""
    program = draw_program("degenerate", 3, 40, rng)
    answer = nearest_point(*program)
    assert answer is not None
    monkeypatch.setattr(module, "_MOST_SETS", 10**6)
    first = nearest_point(*program)
    assert first is not None
    assert answer.v == pytest.approx(first.v, abs=1e-6)


def test_a_point_of_contact_is_found_and_a_gap_of_more_than_rounding_is_seen():
    G = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    assert nearest_point([3.0, 0.5], G, np.array([1.0, -1.0, 1.0, 1.0]), 2.0) == ([1.0, 0.5], (0,))
    assert nearest_point([3.0, 0.5], G, np.array([1.0, -1.0 - 1e-7, 1.0, 1.0]), 2.0) is None
    triangle = np.array([[0.0, 1.0], [0.6, -0.8], [-0.6, -0.8]])
    assert nearest_point([3.0, 0.5], triangle, np.zeros(3), 2.0).v == pytest.approx([0.0, 0.0])
    assert nearest_point([3.0, 0.5], triangle, np.array([0.0, 0.0, -1e-7]), 2.0) is None


@pytest.mark.slow
def test_the_answer_rests_on_the_sets_and_not_on_how_the_iteration_goes(monkeypatch, rng):
    for m, count in ((1, 3), (2, 6), (3, 5)):
        assert module._count(count, m) == len([*module._sets(range(count), m)])
    drawn = [draw_program(kind, 2, 5, rng) for kind in KINDS for _ in range(5)]
    answers = [nearest_point(*program) for program in drawn]
    monkeypatch.setattr(module, "_MOST_STEPS", 0)
    assert [nearest_point(*program) for program in drawn] == answers


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_the_c_of_it_computes_the_same_bits(kind, tmp_path, rng):
    in_c = module.CompiledPoint(library_of(module, tmp_path))
    for _ in range(60):
        program = draw_program(kind, int(rng.integers(1, 9)), int(rng.choice([1, 4, 20])), rng)
        answer = nearest_point(*program)
        assert in_c(*program, None) == answer
        (n, G, g, size), hint = program, answer.rows if answer else (0,)
        assert in_c(n, G, g, size, hint) == strictly_nearest(n, G, g, hint)


@needs_a_compiler
def test_c_with_other_bits_is_refused(tmp_path):
    with pytest.raises(ValueError, match="other bits"):
        module.CompiledPoint(library_of(module, tmp_path, ("round < 2", "round < 1")))
