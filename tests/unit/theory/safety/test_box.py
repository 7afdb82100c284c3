"""A box's distance: smooth, never too large, and too small by no more than its rounding allows."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.function import Body, HeadingAware
from phalanx.theory.safety.obstacles import Box

seeds = st.integers(0, 2**32 - 1)
BOXES = {
    "in the plane": Box((1.0, -2.0), (4.0, 1.0), 0.5, angle=0.7),
    "in space": Box((1.0, -2.0, 3.0), (4.0, 1.0, 2.0), 0.5, angle=-2.0, rounding=0.02),
}


def true_distance(box: Box, p: np.ndarray) -> float:
    """The Euclidean distance of a point from a box, 0 inside."""
    c, s = np.cos(box.angle), np.sin(box.angle)
    q = p - np.array(box.center)
    q[:2] = np.array([[c, s], [-s, c]]) @ q[:2]
    return float(np.linalg.norm(np.maximum(np.abs(q) - np.array(box.size) / 2, 0.0)))


@pytest.mark.parametrize("name", BOXES)
@given(seed=seeds)
def test_the_distance_is_a_lower_bound_that_rounding_makes_smaller(name, seed):
    box = BOXES[name]
    p = np.array(box.center) + np.random.default_rng(seed).normal(scale=3.0, size=len(box.center))
    (found,), true = box.distances(p[None]), true_distance(box, p)
    assert true - np.sqrt(len(p)) * box.rounding <= found <= true + 1e-12


@pytest.mark.parametrize("name", BOXES)
@given(seed=seeds)
def test_the_expression_has_the_value_of_the_numbers_and_a_slope_of_at_most_one(name, seed):
    box = BOXES[name]
    p = np.array(box.center) + np.random.default_rng(seed).normal(scale=3.0, size=len(box.center))
    x = ca.SX.sym("x", len(p))
    value, slope = ca.Function("f", [x], [box.distance(x), ca.gradient(box.distance(x), x)])(p)
    assert float(value) == pytest.approx(box.distances(p[None])[0], abs=1e-12)
    assert np.linalg.norm(slope) <= 1.0 + 1e-9


def test_near_a_face_an_agent_keeps_little_more_than_the_clearance():
    x = ca.SX.sym("x", 2)
    h = ca.Function("h", [x], [Box((0.0, 0.0), (4.0, 2.0), 0.5).intrusion(x)])
    assert float(h([0.0, 1.0 + 0.5])) > 0.0
    assert float(h([0.0, 1.0 + 0.5 + 0.15])) < 0.0


def test_a_unicycle_that_heads_for_a_box_has_a_larger_h_than_one_that_turns_away():
    """Its output point is an expression of its state, in which no derivative can be taken."""
    dynamics = Unicycle(1.0, 1.0)
    x, box = ca.SX.sym("x", 3), BOXES["in the plane"]
    a = Body(x, dynamics.position(x), dynamics.states)
    of_state = ca.Function("h", [x], [HeadingAware(1.0, 0.3).to_obstacle(a, box)])
    point = np.array([5.0, 3.0])
    slopes = [(box.distances(point + s)[0] for s in (e, -e)) for e in 1e-6 * np.eye(2)[:, None]]
    away = np.array([ahead - behind for ahead, behind in slopes])
    heading = np.arctan2(away[1], away[0])
    for turned, more in ((0.0, 0.0), (np.pi / 2, 0.3), (np.pi, 0.6)):
        c, s = np.cos(heading + turned), np.sin(heading + turned)
        h = float(of_state([5.0 - 0.25 * c, 3.0 - 0.25 * s, heading + turned]))
        assert h == pytest.approx(box.clearance + more - box.distances(point[None])[0], abs=1e-6)


def test_a_box_has_its_edges():
    assert len(BOXES["in the plane"].edges()) == 4
    lengths = [np.linalg.norm(np.subtract(*edge)) for edge in BOXES["in space"].edges()]
    assert sorted(np.round(lengths, 9)) == [1.0] * 4 + [2.0] * 4 + [4.0] * 4


def test_a_box_with_another_number_of_sides_is_refused():
    with pytest.raises(ValueError, match="size: expected 2 sides, got 3"):
        Box((0.0, 0.0), (1.0, 1.0, 1.0))
