"""References: a point, waypoints by time or tolerance, a path at a speed, another agent."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.laws.goals import (
    FixedPoint,
    Follow,
    Motion,
    PathAtSpeed,
    Reference,
    Sight,
    Stay,
    Waypoints,
)

CORNER = ((0.0, 0.0), (3.0, 0.0), (3.0, 4.0))


def sight(t: float = 0.0, **places: tuple[float, float]) -> Sight:
    """Return what agent "own" sees at t: agents at these places, all with velocity (1, 0)."""
    seen = {name: Motion(np.array(p), np.array([1.0, 0.0])) for name, p in places.items()}
    return Sight(t, "own", seen.get)


def position(reference: Reference, t: float = 0.0, **places: tuple[float, float]) -> list[float]:
    return reference.goal(sight(t, **places)).position.tolist()


def test_a_point_is_a_goal_at_rest():
    goal = FixedPoint((3.0, 4.0)).goal(sight(7.0))
    assert goal.position.tolist() == [3.0, 4.0]
    assert not goal.velocity.any()


def test_a_path_is_passed_at_its_speed_and_then_rests():
    path = PathAtSpeed(CORNER, speed=2.0)
    assert position(path, 0.5) == [1.0, 0.0]
    assert position(path, 2.5) == [3.0, 2.0]
    assert path.goal(sight(2.5)).velocity.tolist() == [0.0, 2.0]
    assert position(path, 4.0) == [3.0, 4.0] == path.end().tolist()
    assert not path.goal(sight(4.0)).velocity.any()


@given(t=st.floats(0.0, 3.49), speed=st.floats(0.1, 10.0))
def test_a_paths_velocity_has_its_speed(t, speed):
    goal = PathAtSpeed(CORNER, speed).goal(sight(t * 2.0 / speed))
    assert np.linalg.norm(goal.velocity) == pytest.approx(speed)


def test_waypoints_are_reached_at_their_times():
    timed = Waypoints(CORNER, times=(1.0, 2.0, 4.0))
    at = {0.0: [0.0, 0.0], 1.5: [1.5, 0.0], 2.0: [3.0, 0.0], 3.0: [3.0, 2.0], 9.0: [3.0, 4.0]}
    assert {t: position(timed, t) for t in at} == at


def test_waypoints_within_a_tolerance_follow_one_another_in_order():
    passed = Waypoints(CORNER, tolerance=0.5)
    assert position(passed, own=(3.0, 4.0)) == [0.0, 0.0]  # the last place is not the first
    assert position(passed, own=(0.3, 0.4)) == [3.0, 0.0]
    assert position(passed, own=(0.0, 0.0)) == [3.0, 0.0]
    assert position(passed, own=(3.0, 0.0)) == [3.0, 4.0]
    assert position(passed, own=(0.0, 0.0)) == [3.0, 4.0]


def test_waypoints_that_lie_together_are_reached_together():
    assert position(Waypoints(CORNER, tolerance=10.0), own=(0.0, 0.0)) == [3.0, 4.0]


def test_a_follower_has_its_leaders_place_and_velocity():
    goal = Follow("first", (-2.0, 1.0)).goal(sight(own=(9.0, 9.0), first=(5.0, 0.0)))
    assert goal.position.tolist() == [3.0, 1.0]
    assert goal.velocity.tolist() == [1.0, 0.0]


@pytest.mark.parametrize("reference", [Stay(), Follow("first", (-2.0, 1.0))])
def test_without_goal_or_leader_in_sight_the_agent_stays(reference):
    goal = reference.goal(sight(own=(9.0, 8.0)))
    assert goal.position.tolist() == [9.0, 8.0]
    assert not goal.velocity.any()
    assert reference.end() is None
