"""A polygon's distance: smooth, never too large, and too small by no more than it says."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from phalanx.theory.safety.obstacles import Box, Polygon

seeds = st.integers(0, 2**32 - 1)
POLYGONS = {
    "a triangle": Polygon(((0.0, 0.0), (4.0, 0.0), (1.0, 2.0)), 0.5),
    "five corners, in disorder": Polygon(
        ((2.0, 0.0), (-1.2, 1.2), (0.6, 1.9), (-1.2, -1.2), (0.6, -1.9)), rounding=0.02
    ),
    "an octagon": Polygon(
        tuple((3.0 * np.cos(k * np.pi / 4), 3.0 * np.sin(k * np.pi / 4)) for k in range(8)), 1.0
    ),
    "a needle": Polygon(((0.0, 0.0), (9.0, 0.1), (9.0, -0.1)), 0.2),
}


def true_distance(polygon: Polygon, p: np.ndarray) -> float:
    """The Euclidean distance of a point from a polygon, 0 inside."""
    ends = [np.array(edge) for edge in polygon.edges()]
    shares = [np.clip((p - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0) for a, b in ends]
    nearest = min(
        np.linalg.norm(p - a - s * (b - a)) for (a, b), s in zip(ends, shares, strict=True)
    )
    inside = all((b - a)[0] * (p - a)[1] - (b - a)[1] * (p - a)[0] > 0.0 for a, b in ends)
    return 0.0 if inside else float(nearest)


def draw_point(polygon: Polygon, seed: int) -> np.ndarray:
    return np.array(polygon.center) + np.random.default_rng(seed).normal(scale=3.0, size=2)


@pytest.mark.parametrize("name", POLYGONS)
@given(seed=seeds)
def test_the_distance_is_a_lower_bound_nearly_as_large_as_the_true_one(name, seed):
    polygon, p = POLYGONS[name], draw_point(POLYGONS[name], seed)
    (found,), true = polygon.distances(p[None]), true_distance(polygon, p)
    assert found <= true + 1e-12
    assert found >= true / 1.3 - polygon.rounding


@pytest.mark.parametrize("name", POLYGONS)
@given(seed=seeds)
def test_expression_and_numbers_agree_and_the_slope_is_that_of_differences(name, seed):
    polygon, p = POLYGONS[name], draw_point(POLYGONS[name], seed)
    x = ca.SX.sym("x", 2)
    value, slope = ca.Function(
        "f", [x], [polygon.distance(x), ca.gradient(polygon.distance(x), x)]
    )(p)
    assert float(value) == pytest.approx(polygon.distances(p[None])[0], abs=1e-12)
    steps = 1e-6 * np.eye(2)
    differences = polygon.distances(p + steps) - polygon.distances(p - steps)
    np.testing.assert_allclose(slope.full().ravel(), differences / 2e-6, atol=1e-6)
    assert np.linalg.norm(slope.full()) <= 1.0 + 1e-9


@pytest.mark.parametrize("name", POLYGONS)
@given(seed=seeds)
def test_away_is_a_unit_vector_uphill(name, seed):
    polygon, p = POLYGONS[name], draw_point(POLYGONS[name], seed)
    assume(true_distance(polygon, p) > 0.1)
    x = ca.SX.sym("x", 2)
    away = ca.Function("f", [x], [polygon.away(x)])(p).full().ravel()
    assert np.linalg.norm(away) == pytest.approx(1.0)
    here, there = polygon.distances(np.array([p, p + 1e-3 * away]))
    assert there > here


def test_a_box_as_a_polygon_keeps_agents_about_as_far():
    box = Box((1.0, -2.0), (4.0, 1.0), 0.5)
    same = Polygon(((-1.0, -2.5), (3.0, -2.5), (3.0, -1.5), (-1.0, -1.5)), 0.5)
    points = np.array([[1.0, 0.0], [5.0, -2.0], [4.0, -0.5], [-3.0, -5.0]])
    share = same.distances(points) / box.distances(points)
    at_faces, at_corners = [1.03, 1.02], [0.85, 0.85]
    np.testing.assert_allclose(share, at_faces + at_corners, atol=0.01)
    assert same.center == box.center
    assert len(same.edges()) == 4


@pytest.mark.parametrize(
    "corners",
    [
        ((0.0, 0.0), (1.0, 0.0), (2.0, 0.0)),
        ((0.0, 0.0), (4.0, 0.0), (1.0, 1.0), (0.0, 4.0)),
        ((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0)),
        ((0.0, 0.0), (1.0, 0.0), (np.inf, 1.0)),
    ],
)
def test_corners_of_no_convex_polygon_are_refused(corners):
    with pytest.raises(ValueError, match="corners: expected those of a convex polygon"):
        Polygon(corners)
