"""References: points, waypoints, paths, another agent, and slots of a formation."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from phalanx.theory.laws.formation import Formation
from phalanx.theory.laws.goals import (
    FixedPoint,
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
    assert not goal.acceleration.any()


def test_a_path_is_passed_at_its_speed_and_then_rests():
    path = PathAtSpeed(CORNER, speed=2.0)
    assert position(path, 0.5) == [1.0, 0.0]
    assert position(path, 2.5) == [3.0, 2.0]
    assert path.goal(sight(1.5)).velocity.tolist() == [0.0, 2.0]
    assert position(path, 4.0) == [3.0, 4.0] == path.end().tolist()
    assert not path.goal(sight(3.5)).velocity.any()


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
    # Those that lie together are reached together.
    assert position(Waypoints(CORNER, tolerance=10.0), own=(0.0, 0.0)) == [3.0, 4.0]


def test_without_goal_the_agent_stays():
    goal = Stay().goal(sight(own=(9.0, 8.0)))
    assert goal.position.tolist() == [9.0, 8.0]
    assert not goal.velocity.any()
    assert Stay().end() is None


PATH = ((0.0, 0.0), (16.0, 12.0), (24.0, -12.0), (40.0, 0.0))
PLANE = Formation(PATH, finish=24.0, radius=4.0, slots=5)
SPACE = Formation(((0.0, 1.0, 2.0), (3.0, 5.0, 1.0), (4.0, 4.0, 9.0)), 7.0, 2.0, 3)
inside = st.floats(0.01, 0.99)


@pytest.mark.parametrize("formation", [PLANE, SPACE])
@given(share=inside)
def test_velocity_and_acceleration_are_derivatives_of_the_position(formation, share):
    t, dt = share * formation.finish, 1e-4
    for slot in range(formation.slots):
        before, now, after = (formation.goal(slot, t + k * dt) for k in (-1, 0, 1))
        velocity = (after.position - before.position) / (2 * dt)
        acceleration = (after.velocity - before.velocity) / (2 * dt)
        assert now.velocity == pytest.approx(velocity, abs=1e-6)
        assert now.acceleration == pytest.approx(acceleration, abs=1e-6)


@given(share=st.floats(0.0, 1.0))
@example(share=0.0)
@example(share=1.0)
def test_the_centre_runs_along_the_bezier_curve(share):
    """De Casteljau's construction knows nothing of Bernstein polynomials."""
    points = np.array(PATH)
    while len(points) > 1:
        points = (1 - share) * points[:-1] + share * points[1:]
    assert PLANE.center(24.0 * share).position == pytest.approx(points[0], abs=1e-9)


@given(after=st.floats(0.0, 100.0))
def test_after_the_finish_the_formation_rests(after):
    for slot in range(5):
        goal = PLANE.goal(slot, 24.0 + after)
        assert goal.position == pytest.approx(PLANE.goal(slot, 24.0).position)
        assert not goal.velocity.any()
        assert not goal.acceleration.any()


@given(share=st.floats(0.0, 1.2))
def test_slots_stand_evenly_on_the_circle_around_the_centre(share):
    t = share * 24.0
    for slot in range(5):
        spoke = PLANE.goal(slot, t).position - PLANE.center(t).position
        angle = 2 * np.pi * slot / 5
        assert spoke == pytest.approx([4 * np.cos(angle), 4 * np.sin(angle)], abs=1e-9)


@pytest.mark.parametrize("formation", [PLANE, SPACE], ids=["2-D", "3-D"])
def test_a_slots_places_at_many_times_have_the_bits_of_its_goal_at_each(formation: Formation):
    times = np.concatenate([np.linspace(0.0, 1.2 * formation.finish, 200), [formation.finish]])
    for slot in range(formation.slots):
        goals = [formation.goal(slot, t).position for t in times.tolist()]
        np.testing.assert_array_equal(formation.positions(slot, times), np.array(goals))


def test_in_space_the_circle_is_level():
    spokes = [SPACE.goal(k, 1.0).position - SPACE.center(1.0).position for k in range(3)]
    assert [s[2] for s in spokes] == pytest.approx([0, 0, 0])
    assert [np.linalg.norm(s) for s in spokes] == pytest.approx([2, 2, 2])


@pytest.mark.parametrize("path", [((0.0, 0.0), (1.0, 0.0, 0.0)), ((0.0,), (1.0,))])
def test_control_points_of_unequal_or_odd_dimension_are_refused(path):
    with pytest.raises(ValueError, match="path: expected control points"):
        Formation(path, 1.0, 1.0, 1)
