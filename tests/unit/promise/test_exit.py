"""Leaving with a velocity that all share: slower members never reach who does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.guarantee.promise import grades
from phalanx.promise.capsules import Capsules, balls
from phalanx.promise.exit import Chasers, swept
from phalanx.promise.reach import Reach
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.committed import committed_point
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.integrators import DoubleIntegrator
from tests.unit.promise.test_runs import scenario, simulate

W = np.array([1.5, 0.0])


def chaser_at(p, offset: float, speed: float, time: float = 0.0) -> Chasers:
    return Chasers(*(np.array([number]) for number in (p, offset, speed, time)))


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), axes=st.sampled_from([2, 3]), share=st.floats(0.05, 3.0))
def test_no_chaser_comes_nearer_than_its_gap_and_one_comes_as_near(seed, axes, share):
    """A gap is for ever; of one that is as fast for the time for which it is counted."""
    rng = np.random.default_rng(seed)
    velocity, time = rng.normal(size=axes), float(rng.uniform(0.0, 3.0))
    speed = share * float(np.linalg.norm(velocity))
    start, p = rng.uniform(-3.0, 3.0, (2, axes))
    gap = chaser_at(start, 0.0, speed, time).gaps(balls(p[None], np.zeros(1)), velocity)[0]
    # Straight to where the point will be is as fast as it gets, at each time.
    times = np.linspace(0.0, 60.0 if share < 1.0 else time, 6001)
    way = np.linalg.norm(p + times[:, None] * velocity - start, axis=1) - speed * times
    assert gap <= way.min() + 1e-9
    if way.min() > 0.0:
        assert gap >= way.min() - 0.05


def test_a_set_is_as_near_as_its_nearest_point():
    chaser = chaser_at([-2.0, 1.0], 0.5, 1.0)
    segment = Capsules(np.array([[0.0, 0.0]]), np.array([[0.0, 2.0]]), np.array([0.25]))
    ends = [balls(np.array([[0.0, y]]), np.array([0.25])) for y in (0.0, 1.0, 2.0)]
    alone = [chaser.gaps(end, W)[0] for end in ends]
    assert chaser.gaps(segment, W)[0] <= min(alone)
    assert chaser.gaps(segment, W)[0] == pytest.approx(1.25, abs=1e-5)


def test_a_first_speed_brings_a_chaser_nearer_by_its_offset():
    point = balls(np.zeros((1, 2)), np.zeros(1))
    slow, fast = (chaser_at([-2.0, 0.0], offset, 1.0).gaps(point, W)[0] for offset in (0.0, 0.5))
    assert slow - fast == 0.5


def test_a_faster_one_comes_down_to_what_drag_allows():
    robot = Reach(DoubleIntegrator(acceleration=1.0, drag=2.0, dimension=2), 0.0)
    x, t, p = np.array([0.0, 0.0, 3.0, 4.0]), 0.0, 0.0
    offset, speed = robot.for_ever(x)
    v = 5.0
    while t < 10.0:
        p, v, t = p + 1e-3 * v, v + 1e-3 * (np.sqrt(2.0) - 2.0 * v), t + 1e-3
        assert p <= offset + speed * t + 1e-2
    assert offset + speed * t - p < 0.01
    assert Reach(DoubleIntegrator(acceleration=1.0, dimension=2), 0.0).for_ever(x)[1] == np.inf


def test_the_way_out_contains_all_that_is_passed():
    tube = Capsules(np.array([[0.0, 0.0]]), np.array([[0.1, 0.4]]), np.array([0.2]))
    way = swept(tube, W)
    for share in (0.0, 0.5, 1.0):
        places = tube.begin + share * (tube.end - tube.begin)
        points = places + np.linspace(0.0, 50.0, 40)[:, None] * W
        assert way.gaps(balls(points, np.full(40, 0.2))).max() <= -0.4 + 1e-9


LEAVING = {
    "safety__keep": {"exit": [1.5, 0.0]},
    "agents__0__dynamics": {"type": "single-integrator", "speed": 2.5},
    "agents__0__start": [[0.0, -1.2], [0.0, 1.2]],
    "agents__0__goal": [[0.0, 3.0], [0.0, -3.0]],
    "agents__1__dynamics": {"type": "unicycle", "speed": 0.8, "turn_rate": 2.0},
    "agents__1__start": [[-3.5, 0.0, 0.0]],
    "obstacles": [{"center": [4.0, 8.0], "clearance": 0.5}],
}
"""Two that want to swap their places, and a slower one that hunts them."""


@pytest.mark.slow
def test_a_slower_pursuer_never_hits_and_the_promise_is_for_ever():
    free = simulate(scenario(**LEAVING | {"safety__keep": None}))
    assert free.violations
    summary = simulate(scenario(**LEAVING, duration=6.0))
    assert summary.violations == []
    assert str(summary.promise) == "kept for 5 of 5 pairs (5 for ever, 0 passively)"
    assert summary.origins["fallback"] > 20


def test_in_the_moving_frame_a_point_has_less_of_its_inputs_and_its_speed_less_w():
    dynamics = {"type": "double-integrator", "acceleration": 4.0, "drag": 0.5, "dimension": 2}
    swarm = build_swarm(
        scenario(
            safety__keep={"exit": [1.5, -2.0]},
            safety__alpha=[2.0, 2.0],
            agents__0__dynamics=dynamics,
            agents__0__law={"type": "track", "gains": [1.0, 2.0]},
            agents__0__start=[[0.0, -2.5, 0.0, 0.0], [0.0, 2.5, 0.0, 0.0]],
            agents__1__dynamics=dynamics,
            agents__1__law={"type": "chase", "gains": [1.0, 2.0]},
            agents__1__start=[[-6.0, 0.0, 0.0, 0.0]],
        )
    )
    point, x, u = committed_point(swarm, 0), np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.25, 0.5])
    assert point.motion.acceleration == 4.0 - 0.5 * 2.0
    own, w = point.of_both(x, u)
    assert own.tolist() == point.of(x).tolist() == [1.0, 2.0, 3.0 - 1.5, 4.0 + 2.0]
    assert w.tolist() == [0.25 - 0.75, 0.5 + 1.0]
    assert point.applied(x, w).tolist() == u.tolist()


@pytest.mark.slow
def test_one_that_is_faster_is_outrun_for_a_time_that_check_says_with_both_speeds():
    fast = {"agents__1__dynamics": {"type": "unicycle", "speed": 2.4, "turn_rate": 2.0}}
    graded = grades(build_swarm(scenario(**LEAVING | fast)))
    assert "a-b" in graded.for_ever
    assert graded.faster == "rogue makes 2.45 m/s, the exit 1.5"
    # Both are as far from it, and it gains .95 m/s.
    assert graded.until["a-rogue"] == graded.until["b-rogue"] == pytest.approx(2.4, abs=0.3)
    summary = simulate(scenario(**LEAVING | fast, duration=5.0))
    assert min(v.first for v in summary.violations) > graded.until["a-rogue"]
    assert summary.promise.kept
    assert "(3 for ever, 0 passively, 2 for its time)" in str(summary.promise)


def test_check_says_how_much_too_near_a_chaser_starts():
    graded = grades(build_swarm(scenario(**LEAVING | {"agents__1__start": [[3.0, 1.2, 0.0]]})))
    assert "m nearer than it may start" in graded.short["b-rogue"]
    assert "a-b" in graded.for_ever


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"safety__keep": {"exit": [2.45, 0.0]}}, "disturbance.bound of a: .* at most 0.0"),
        ({"safety__keep": {"exit": [2.6, 0.0]}}, "disturbance.bound of a: .* none would do"),
        ({"safety__keep": {"exit": [1.5, 0.0, 0.0]}}, "exit: expected 2 numbers, got 3"),
        ({"safety__keep": {"exit": [0.0, 0.0]}}, "keep.exit: expected a velocity"),
        ({"agents__0__sensing": 9.0}, "sensing of a: expected none"),
        ({"obstacles": [{"center": [9.0, 9.0], "size": [1.0, 1.0], "clearance": 0.5}]},
         "obstacles: expected spheres"),
        ({"agents__0__dynamics": {"type": "unicycle", "speed": 2.0, "turn_rate": 2.0},
          "agents__0__start": [[0.0, -1.2, 0.0], [0.0, 1.2, 0.0]]},
         "dynamics of a: expected a single- or double-integrator"),
    ],
)  # fmt: skip
def test_an_exit_that_cannot_be_kept_is_refused_with_the_fix(changes, why):
    with pytest.raises(ScenarioError, match=why):
        require_runnable(build_swarm(scenario(**LEAVING | changes)))
