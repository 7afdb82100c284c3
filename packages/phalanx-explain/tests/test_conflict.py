"""The least set of rows that exclude one another, compared with every subset."""

from itertools import chain, combinations

import numpy as np
import pytest
from phalanx_explain.conflict import given_up, least_conflict

from phalanx.theory.arrays import Array
from phalanx.theory.models.polytope import Polytope, polytope
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows


def inputs(axes: int) -> Polytope:
    return polytope(np.vstack([np.eye(axes), -np.eye(axes)]), np.ones(2 * axes))


def excluded(rows: Rows, chosen: tuple[int, ...]) -> bool:
    axes = rows.a.shape[1]
    some = Rows(rows.a[list(chosen)], rows.bound[list(chosen)])
    return NearestInput((1.0,) * axes).solve(np.zeros(axes), inputs(axes), some) is None


def random_rows(rng: np.random.Generator, axes: int, count: int) -> Rows:
    a: Array = rng.normal(size=(count, axes))
    return Rows(a, rng.uniform(-1.5, 0.5, count))


@pytest.mark.slow
@pytest.mark.parametrize(("axes", "count"), [(1, 4), (2, 6), (3, 7)])
def test_a_least_conflict_is_as_small_as_any_subset_that_no_input_keeps(axes, count, rng):
    conflicts = 0
    for _ in range(40):
        rows = random_rows(rng, axes, count)
        subsets = chain.from_iterable(combinations(range(count), k) for k in range(1, count + 1))
        first = next((s for s in subsets if excluded(rows, s)), ())
        assert least_conflict(inputs(axes), rows) == first
        conflicts += bool(first)
    assert conflicts > 10


def test_rows_that_some_input_keeps_have_no_conflict():
    rows = Rows(np.eye(2), np.array([-0.5, -0.5]))
    assert least_conflict(inputs(2), rows) == ()


def test_each_row_of_a_conflict_gives_as_little_as_the_worst_has_to():
    opposed = Rows(np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0]]), np.array([-0.3, -0.5, 0.9]))
    conflict = least_conflict(inputs(2), opposed)
    assert conflict == (0, 1)
    assert given_up(inputs(2), opposed, conflict) == pytest.approx([0.4, 0.4])
