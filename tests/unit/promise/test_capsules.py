"""Capsules: their distances are those of the points in them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.promise.capsules import ROUNDING, Capsules, Statics, balls, joined
from phalanx.theory.safety.obstacles import Box, Polygon, Sphere, Wall

SHARES = np.linspace(0.0, 1.0, 201)


def random_capsules(rng: np.random.Generator, count: int, axes: int) -> Capsules:
    begin = rng.uniform(-3.0, 3.0, (count, axes))
    # Points, short ones, and some along one line.
    end = begin + rng.choice([0.0, 1e-9, 1.0], (count, 1)) * rng.normal(size=(count, axes))
    return Capsules(begin, end, rng.uniform(0.0, 0.5, count))


def points(capsules: Capsules, k: int) -> np.ndarray:
    return capsules.begin[k] + SHARES[:, None] * (capsules.end[k] - capsules.begin[k])


@pytest.mark.slow
@settings(max_examples=50)
@given(seed=st.integers(0, 10**6), axes=st.sampled_from([2, 3]))
def test_a_gap_is_the_least_distance_of_all_points(seed, axes):
    rng = np.random.default_rng(seed)
    capsules, others = random_capsules(rng, 3, axes), random_capsules(rng, 2, axes)
    for l, gap in enumerate(capsules.gaps(others)):
        apart = min(
            np.linalg.norm(points(capsules, k)[:, None] - points(others, l)[None], axis=2).min()
            - capsules.radius[k]
            - others.radius[l]
            for k in range(3)
        )
        assert gap <= apart
        assert gap >= apart - 0.03


@pytest.mark.parametrize("turn", [0.0, 1e-9, 1e-7, 1e-4])
def test_segments_almost_along_one_another_are_as_far_as_they_are(turn):
    one = Capsules(np.array([[0.0, 0.0]]), np.array([[10.0, 0.0]]), np.zeros(1))
    two = Capsules(np.array([[2.0, 1.0]]), np.array([[12.0, 1.0 + 10.0 * turn]]), np.zeros(1))
    assert one.gaps(two)[0] == pytest.approx(1.0 - ROUNDING, abs=1e-8)


def test_segments_that_cross_have_no_distance():
    one = Capsules(np.array([[-1.0, -1.0]]), np.array([[1.0, 1.0]]), np.zeros(1))
    two = Capsules(np.array([[-1.0, 1.0]]), np.array([[1.0, -1.0]]), np.array([0.25]))
    assert one.gaps(two)[0] == pytest.approx(-0.25 - ROUNDING)


OBSTACLES = [
    Sphere((0.0, 0.0), 0.7),
    Wall((1.0, 1.0), 2.0, 0.3),
    Box((0.5, 0.0), (2.0, 1.0), 0.4, 0.3),
    Polygon(((0.0, 0.0), (2.0, 0.0), (0.0, 2.0)), 0.2),
]


@settings(max_examples=50)
@given(seed=st.integers(0, 10**6), obstacle=st.sampled_from(OBSTACLES))
def test_no_point_is_nearer_to_an_obstacle_than_a_gap_says(seed, obstacle):
    capsules = random_capsules(np.random.default_rng(seed), 2, 2)
    least = min(
        (obstacle.distances(points(capsules, k)) - capsules.radius[k]).min() for k in range(2)
    )
    gap = Statics([obstacle]).gaps(capsules)[0]
    assert gap <= least - obstacle.clearance
    # Where the ends are far enough, a gap may be too small by half of the segment.
    half = 0.0 if gap < 0.0 else 0.5 * np.linalg.norm(capsules.end - capsules.begin, axis=1).max()
    assert gap >= least - obstacle.clearance - half - 0.05


def test_obstacles_have_their_gaps_in_their_order():
    some = Capsules(np.array([[3.0, 3.0]]), np.array([[3.0, 4.0]]), np.array([0.1]))
    mixed = [OBSTACLES[2], Sphere((3.0, 6.0), 0.5), OBSTACLES[3], OBSTACLES[0]]
    alone = [Statics([obstacle]).gaps(some)[0] for obstacle in mixed]
    assert Statics(mixed).gaps(some).tolist() == alone
    assert alone[1] == pytest.approx(2.0 - 0.5 - 0.1 - ROUNDING)


@pytest.mark.parametrize("number", range(len(OBSTACLES)))
def test_the_gap_of_a_point_is_that_to_the_nearest_obstacle(number):
    p, others = np.array([9.0, 9.0]), [Sphere((-90.0, 0.0), 1.0), Wall((-1.0, 0.0), 90.0)]
    obstacles = [*others, OBSTACLES[number]]
    gap = OBSTACLES[number].distances(p[None])[0] - OBSTACLES[number].clearance
    assert Statics(obstacles).gap(p) == pytest.approx(gap - ROUNDING)
    assert Statics(others).gap(p) > gap + 1e-3
    assert Statics([]).gap(p) == np.inf


def test_no_capsule_is_infinitely_far():
    nothing = joined([], 2)
    some = balls(np.zeros((1, 2)), np.ones(1))
    assert nothing.gaps(some).tolist() == [np.inf]
    assert some.gaps(nothing).tolist() == []
    assert Statics(OBSTACLES).gaps(nothing).tolist() == [np.inf] * 4
