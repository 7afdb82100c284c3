"""The input with the least worst violation: one answer to the last bit, in Python and in C."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest

from phalanx.theory.models.polytope import Polytope, polytope
from phalanx.theory.rows import least_violation as module
from phalanx.theory.rows.least_violation import LeastVertex, least_vertex, least_violation
from phalanx.theory.rows.row import Rows
from tests.unit.theory.rows.native_pieces import library_of, needs_a_compiler

KINDS = ("random", "parallel", "small integers", "through one point", "unknown", "large")


def draw_rows(kind: str, m: int, count: int, rng: np.random.Generator) -> tuple[Polytope, Rows]:
    """A box, often with a corner cut off, and rows that mostly no input keeps."""
    A, b = np.vstack([np.eye(m), -np.eye(m)]), np.full(2 * m, rng.uniform(0.5, 2.0))
    if rng.uniform() < 0.5:
        A, b = np.vstack([A, np.ones(m)]), np.append(b, 0.4 * m)
    a, bound = rng.normal(size=(count, m)), -rng.uniform(0.0, 4.0, count)
    if kind == "parallel":
        a[count // 2 :] = a[: count - count // 2] * rng.choice([1.0, -1.0, 0.3])
    if kind == "small integers":
        a, bound = rng.integers(-1, 2, a.shape) * 1.0, -rng.integers(0, 3, count) * 1.0
        b[:] = 1.0
    if kind == "through one point":
        bound = a @ rng.uniform(-0.3, 0.3, m) - 1.0
    if kind == "unknown":
        bound[rng.uniform(size=count) < 0.5] = -np.inf
    if kind == "large":
        a *= 10.0 ** rng.uniform(-6, 40, (count, 1))
    return polytope(A, b), Rows(a, bound)


def exactly_least(inputs: Polytope, rows: Rows) -> Fraction:
    """The least worst violation in rational numbers, at the best of all vertices."""
    table = [[*map(Fraction, a), Fraction(-1), Fraction(b)] for a, b in _lists(rows.a, rows.bound)]
    table += [[*map(Fraction, a), Fraction(0), Fraction(b)] for a, b in _lists(inputs.A, inputs.b)]
    points = (_meet(chosen) for chosen in combinations(table, inputs.A.shape[1] + 1))
    return min(
        x[-1]
        for x in points
        if x is not None
        and all(sum(c * y for c, y in zip(row, x, strict=False)) <= row[-1] for row in table)
    )


def exact_violation(rows: Rows, u: np.ndarray) -> Fraction:
    """The worst violation of an input in rational numbers."""
    exact = [Fraction(x) for x in u.tolist()]
    return max(
        sum(Fraction(c) * x for c, x in zip(a, exact, strict=True)) - Fraction(b)
        for a, b in _lists(rows.a, rows.bound)
    )


def _lists(a: np.ndarray, b: np.ndarray) -> list[tuple[list[float], float]]:
    return list(zip(a.tolist(), b.tolist(), strict=True))


def _meet(rows) -> list[Fraction] | None:
    """Gauss and Jordan's elimination; None if the rows are dependent."""
    table = [list(row) for row in rows]
    for k in range(len(table)):
        pivot = next((j for j in range(k, len(table)) if table[j][k]), None)
        if pivot is None:
            return None
        table[k], table[pivot] = table[pivot], table[k]
        table[k] = [value / table[k][k] for value in table[k]]
        for j in range(len(table)):
            if j != k and table[j][k]:
                factor = table[j][k]
                table[j] = [x - factor * y for x, y in zip(table[j], table[k], strict=True)]
    return [row[-1] for row in table]


@pytest.mark.parametrize("kind", ["random", "parallel", "small integers", "through one point"])
@pytest.mark.parametrize("m", [1, 2])
def test_no_input_violates_less_in_rational_arithmetic(kind, m, rng):
    for _ in range(8):
        inputs, rows = draw_rows(kind, m, int(rng.integers(1, 5)), rng)
        u = least_violation(inputs, rows)
        assert inputs.takes(u)
        assert float(exact_violation(rows, u) - exactly_least(inputs, rows)) <= 1e-8


def test_of_inputs_that_violate_equally_the_least_is_taken_and_zeros_have_no_sign():
    square = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
    rows = Rows(np.array([[0.0, 1.0], [0.0, -1.0]]), np.array([-1.0, -1.0]))
    u = least_violation(square, rows)
    assert u.tolist() == [-1.0, 0.0]
    assert not np.signbit(u[1])


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_the_c_of_it_computes_the_same_bits(kind, tmp_path, rng):
    in_c, calls = LeastVertex(), []
    compiled = module.CompiledVertex(library_of(module, tmp_path))
    in_c._compiled = lambda table: calls.append(1) or compiled(table)
    for _ in range(60):
        m, count = int(rng.integers(1, 5)), int(rng.choice([1, 2, 5, 8]))
        inputs, rows = draw_rows(kind, m, count, rng)
        u = least_violation(inputs, rows, in_c)
        assert u.tobytes() == least_violation(inputs, rows).tobytes()
    assert (len(calls) == 60) is (kind != "large")


@needs_a_compiler
def test_c_finds_no_vertex_where_python_finds_none(tmp_path):
    compiled = module.CompiledVertex(library_of(module, tmp_path))
    for table in ([[1.0, -1.0], [-1.0, -1.0]], [[0.0, 1.0]], [[-1.0, 3.0]]):
        A, b = np.array(table)[:, :1], np.array(table)[:, 1]
        assert compiled(np.array(table)) == least_vertex(A, b)


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize(
    "change",
    [("1e-9", "1e-1"), ("x[d - 1] < best", "x[d - 1] > best"), ("c = d - 1; c", "c = d - 2; c")],
)
def test_c_with_other_bits_is_refused(change, tmp_path):
    with pytest.raises(ValueError, match="other bits"):
        module.CompiledVertex(library_of(module, tmp_path, change))
