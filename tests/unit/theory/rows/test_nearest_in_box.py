"""The nearest input of a box under one row: one answer to the last bit, in Python and in C."""

from itertools import product

import numpy as np
import pytest

from phalanx.theory.models.polytope import Box
from phalanx.theory.rows import nearest_in_box as module
from phalanx.theory.rows.nearest_in_box import TOLERANCE, NearestInBox, nearest_in_box
from phalanx.theory.rows.row import Row
from tests.unit.theory.rows.native_pieces import library_of, needs_a_compiler
from tests.unit.theory.rows.test_nearest_point import exactly_nearest

Program = tuple[list[float], list[float], list[float], list[float], list[float], float]
"""u_nom, weights, low, high, a and bound."""
KINDS = ("random", "small integers", "far", "a corner", "points", "empty")


def draw_box_program(kind: str, m: int, rng: np.random.Generator) -> Program:
    """A program in a box; weights are squares of rational numbers, so that it can be exact."""
    weights, u_nom, a = (
        rng.choice([0.25, 1.0, 4.0], m),
        rng.normal(size=m) * 3.0,
        rng.normal(size=m),
    )
    low, high = np.sort(rng.normal(size=(2, m)), axis=0)
    if kind == "small integers":
        u_nom, a = rng.integers(-2, 3, m) * 1.0, rng.integers(-1, 2, m) * 1.0
        low, high = -np.ones(m), np.ones(m)
    if kind == "far":
        u_nom, a = u_nom * 1e5, a * 10.0 ** rng.uniform(-8, 8)
    if kind == "points":
        high = low.copy()
    least, most = np.minimum(a * low, a * high).sum(), np.maximum(a * low, a * high).sum()
    share = {"a corner": rng.choice([0.0, -1e-8, 1e-8, -1e-6]), "empty": -rng.uniform(0.0, 0.5)}
    bound = least + share.get(kind, rng.uniform(0.0, 1.0)) * (most - least)
    lists = (x.tolist() for x in (u_nom, weights, low, high, a))
    return (*lists, round(bound) * 1.0 if kind == "small integers" else float(bound))  # type: ignore


def exactly_nearest_in_box(program: Program) -> list[float] | None:
    """The same point in rational numbers, by trying all sets of rows: √w is rational here."""
    u_nom, weights, low, high, a, bound = map(np.array, program)
    roots, unit = np.sqrt(weights), np.eye(len(u_nom))
    rows = np.vstack([unit, -unit, a / roots])
    v = exactly_nearest(
        (u_nom * roots).tolist(), rows, np.concatenate([high * roots, -low * roots, [bound]])
    )
    return None if v is None else [float(x) / root for x, root in zip(v, roots, strict=True)]


@pytest.mark.parametrize("kind", ["random", "small integers", "empty"])
@pytest.mark.parametrize("m", [1, 2])
def test_the_answer_is_that_of_rational_arithmetic(kind, m, rng):
    for _ in range(15):
        program = draw_box_program(kind, m, rng)
        u, exact = nearest_in_box(*program, TOLERANCE), exactly_nearest_in_box(program)
        assert (u is None) == (exact is None)
        assert u is None or u == pytest.approx(exact, abs=1e-12)


def solve(program: Program, compiled) -> np.ndarray | None:
    u_nom, weights, low, high, a, bound = program
    solver = NearestInBox(weights)
    solver._compiled = compiled
    return solver.solve(
        np.array(u_nom), Box(np.array(low), np.array(high)), Row(np.array(a), bound)
    )


def same(u: np.ndarray | None, other: np.ndarray | None) -> bool:
    return (u is None) is (other is None) and (u is None or u.tobytes() == other.tobytes())


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_the_c_of_it_computes_the_same_bits(kind, tmp_path, rng):
    compiled = module._checked(library_of(module, tmp_path))
    for _ in range(400):
        program = draw_box_program(kind, int(rng.integers(1, 9)), rng)
        assert same(solve(program, compiled), solve(program, None)), program


@needs_a_compiler
def test_numbers_that_are_not_finite_are_the_same_in_c(tmp_path):
    compiled = module._checked(library_of(module, tmp_path))
    numbers = (np.nan, np.inf, -np.inf, -0.0)
    for nominal, a, bound in product((0.5, -0.0, np.nan), (*numbers, 1.0), (*numbers, -0.5)):
        program = ([nominal, 3.0], [1.0, 4.0], [-1.0, -0.0], [1.0, 1.0], [a, 1.0], bound)
        with np.errstate(all="ignore"):
            assert same(solve(program, compiled), solve(program, None)), program


@needs_a_compiler
@pytest.mark.parametrize(
    "change",
    [
        ("begin + ", "1e-15 + begin + "),
        ("tolerance * sizes", "0.9"),
        ("u[c] = free < low[c]", "u[c] = free < 0.0"),
    ],
)
def test_c_with_other_bits_is_refused(change, tmp_path):
    with pytest.raises(ValueError, match="other bits"):
        module._checked(library_of(module, tmp_path, change))
