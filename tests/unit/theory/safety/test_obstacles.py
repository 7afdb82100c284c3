"""Distances of boxes and polygons: smooth, never too large, and too small by no more than said."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.function import Body, HeadingAware
from phalanx.theory.safety.obstacles import Box, Polygon

seeds = st.integers(0, 2**32 - 1)
BOX = Box((1.0, -2.0), (4.0, 1.0), 0.5, angle=0.7)
IN_SPACE = Box((1.0, -2.0, 3.0), (4.0, 1.0, 2.0), 0.5, angle=-2.0, rounding=0.02)
SHAPES: dict[str, Box | Polygon] = {
    "a box": BOX,
    "a box in space": IN_SPACE,
    "a triangle": Polygon(((0.0, 0.0), (4.0, 0.0), (1.0, 2.0)), 0.5),
    "five corners, in disorder": Polygon(
        ((2.0, 0.0), (-1.2, 1.2), (0.6, 1.9), (-1.2, -1.2), (0.6, -1.9)), rounding=0.02
    ),
    "an octagon": Polygon(
        tuple((3.0 * np.cos(k * np.pi / 4), 3.0 * np.sin(k * np.pi / 4)) for k in range(8)), 1.0
    ),
    "a needle": Polygon(((0.0, 0.0), (9.0, 0.1), (9.0, -0.1)), 0.2),
}


def true_distance(shape: Box | Polygon, p: np.ndarray) -> float:
    """The Euclidean distance of a point from a shape, 0 inside."""
    if isinstance(shape, Box):
        c, s = np.cos(shape.angle), np.sin(shape.angle)
        q = p - np.array(shape.center)
        q[:2] = np.array([[c, s], [-s, c]]) @ q[:2]
        return float(np.linalg.norm(np.maximum(np.abs(q) - np.array(shape.size) / 2, 0.0)))
    ends = [np.array(edge) for edge in shape.edges()]
    shares = [np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0) for a, b in ends]
    nearest = min(
        np.linalg.norm(p - a - s * (b - a)) for (a, b), s in zip(ends, shares, strict=True)
    )
    inside = all((b - a)[0] * (p - a)[1] - (b - a)[1] * (p - a)[0] > 0.0 for a, b in ends)
    return 0.0 if inside else float(nearest)


@cache
def expressions(name: str) -> ca.Function:
    """p -> the distance, its gradient, and the direction away."""
    shape = SHAPES[name]
    x = ca.SX.sym("x", len(shape.center))
    distance = shape.distance(x)
    return ca.Function("f", [x], [distance, ca.gradient(distance, x), shape.away(x)])


def draw_point(shape: Box | Polygon, seed: int) -> np.ndarray:
    center = np.array(shape.center)
    return center + np.random.default_rng(seed).normal(scale=3.0, size=len(center))


@pytest.mark.parametrize("name", SHAPES)
@given(seed=seeds)
def test_the_distance_is_a_lower_bound_nearly_as_large_as_the_true_one(name, seed):
    shape, p = SHAPES[name], draw_point(SHAPES[name], seed)
    (distance,), true = shape.distances(p[None]), true_distance(shape, p)
    assert distance <= true + 1e-12
    if isinstance(shape, Box):
        assert distance >= true - np.sqrt(len(p)) * shape.rounding
    else:
        assert distance >= true / 1.3 - shape.rounding


@pytest.mark.parametrize("name", SHAPES)
@given(seed=seeds)
def test_expression_and_numbers_agree_and_the_slope_is_that_of_differences(name, seed):
    shape, p = SHAPES[name], draw_point(SHAPES[name], seed)
    value, slope, _ = expressions(name)(p)
    assert float(value) == pytest.approx(shape.distances(p[None])[0], abs=1e-12)
    steps = 1e-6 * np.eye(len(p))
    differences = shape.distances(p + steps) - shape.distances(p - steps)
    np.testing.assert_allclose(slope.full().ravel(), differences / 2e-6, atol=1e-6)
    assert np.linalg.norm(slope.full()) <= 1.0 + 1e-9


@pytest.mark.parametrize("name", SHAPES)
@given(seed=seeds)
def test_away_is_a_unit_vector_uphill(name, seed):
    shape, p = SHAPES[name], draw_point(SHAPES[name], seed)
    assume(true_distance(shape, p) > 0.1)
    away = expressions(name)(p)[2].full().ravel()
    assert np.linalg.norm(away) == pytest.approx(1.0)
    here, there = shape.distances(np.array([p, p + 1e-3 * away]))
    assert there > here


def test_near_a_face_an_agent_keeps_little_more_than_the_clearance():
    x = ca.SX.sym("x", 2)
    h = ca.Function("h", [x], [Box((0.0, 0.0), (4.0, 2.0), 0.5).intrusion(x)])
    assert float(h([0.0, 1.0 + 0.5])) > 0.0
    assert float(h([0.0, 1.0 + 0.5 + 0.15])) < 0.0


def test_a_unicycle_that_heads_for_a_box_has_a_larger_h_than_one_that_turns_away():
    """Its output point is an expression of its state, in which no derivative can be taken."""
    dynamics, x = Unicycle(1.0, 1.0), ca.SX.sym("x", 3)
    a = Body(x, dynamics.position(x), dynamics.states)
    h_of_state = ca.Function("h", [x], [HeadingAware(1.0, 0.3).to_obstacle(a, BOX)])
    point = np.array([5.0, 3.0])
    slopes = [(BOX.distances(point + s)[0] for s in (e, -e)) for e in 1e-6 * np.eye(2)[:, None]]
    away = np.array([ahead - behind for ahead, behind in slopes])
    heading = np.arctan2(away[1], away[0])
    for turned, more in ((0.0, 0.0), (np.pi / 2, 0.3), (np.pi, 0.6)):
        c, s = np.cos(heading + turned), np.sin(heading + turned)
        h = float(h_of_state([5.0 - 0.25 * c, 3.0 - 0.25 * s, heading + turned]))
        assert h == pytest.approx(BOX.clearance + more - BOX.distances(point[None])[0], abs=1e-6)


def test_a_box_has_its_edges():
    assert len(BOX.edges()) == 4
    lengths = [np.linalg.norm(np.subtract(*edge)) for edge in IN_SPACE.edges()]
    assert sorted(np.round(lengths, 9)) == [1.0] * 4 + [2.0] * 4 + [4.0] * 4


def test_a_box_with_another_number_of_sides_is_refused():
    with pytest.raises(ValueError, match="size: expected 2 sides, got 3"):
        Box((0.0, 0.0), (1.0, 1.0, 1.0))
