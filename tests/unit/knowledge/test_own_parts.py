"""Own parts of agents that know one another by radio: kept, or braked, at any age."""

import numpy as np
import pytest

from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion
from phalanx.knowledge.own_parts import OwnParts
from phalanx.knowledge.sets import HeardState
from phalanx.theory.rows.row import Rows
from tests.unit.knowledge.adverse import gap
from tests.unit.knowledge.swarms import RADIUS, Radio, cross

PLANE = PointMotion(2, 4.0, 0.0, 0.0, longest=0.05, shortest=0.02)
DRAG = PointMotion(2, 4.0, 0.6, 0.0, longest=0.05, shortest=0.02)


def heard(x, t=0.0) -> HeardState:
    x = np.array(x, dtype=float)
    return HeardState(t, x, x, t, np.zeros(len(x) // 2))


@pytest.mark.slow
@pytest.mark.parametrize(
    "motion",
    [pytest.param(PLANE, id="no drag"), pytest.param(DRAG, id="drag", marks=pytest.mark.nightly)],
)
@pytest.mark.parametrize(
    "radio",
    [Radio(), Radio(0.3, every=5), Radio(0.9), Radio(0.3, every=5, partition=(0.8, 2.0))],
    ids=["no loss", "loss .3", "loss .9", "a partition"],
)
def test_agents_that_cross_stay_apart_at_any_loss_and_no_gap_used_is_above_the_truth(motion, radio):
    above = []

    def compare(t, i, members, result):
        for l, claim in result.gaps.items():
            true = gap(members[i].x, members[l].x, motion, motion, RADIUS)
            above.append(claim - true)

    end = cross(5, radio, 1, motion=motion, circle=4.0, duration=4.0, observe=compare)
    assert end.least > 0.0
    assert max(above) <= 0.0


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_agents_that_keep_right_arrive_where_three_of_ten_broadcasts_are_lost(loss):
    end = cross(4, Radio(loss, every=5), 2, motion=PLANE, circle=5.0, duration=20.0)
    assert end.arrived == 4
    assert end.least > 0.0


def test_an_agent_stands_until_it_has_heard_its_peers():
    parts = OwnParts(PLANE, {1: PLANE, 2: PLANE}, RADIUS, 3.5)
    far = heard([50.0, 0.0, 0.0, 0.0])
    wish = np.array([1.0, 0.0])
    first = parts(0.0, np.zeros(4), {1: far}, wish)
    assert first.stands
    np.testing.assert_allclose(first.u, np.zeros(2), atol=1e-12)
    then = parts(0.04, np.zeros(4), {1: far, 2: far}, wish)
    assert not then.stands
    np.testing.assert_array_equal(then.u, wish)
    assert then.binding is None
    assert set(then.gaps) == set(then.sets) == {1, 2}


def test_a_wish_that_spends_too_much_gives_way_and_the_peer_is_named():
    parts = OwnParts(PLANE, {3: PLANE, 7: PLANE}, RADIUS, 3.5)
    known = {3: heard([9.0, 9.0, 0.0, 0.0]), 7: heard([1.5, 0.0, 0.0, 0.0])}
    result = parts(0.0, np.array([0.0, 0.0, 0.5, 0.0]), known, np.array([4.0, 0.5]))
    assert result.u[0] < 3.0
    assert result.binding == 7


def test_a_peer_that_was_heard_long_ago_makes_an_agent_brake():
    parts = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5)
    x = np.array([0.0, 0.0, 1.0, 0.0])
    result = parts(9.0, x, {1: heard([4.0, 0.0, 0.0, 0.0])}, np.array([4.0, 0.0]))
    assert result.gaps[1] < 0.0
    assert result.u[0] <= -3.0


def test_whole_rows_are_kept_where_own_parts_allow():
    parts = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5)
    known = {1: heard([2.0, 0.0, 0.0, 0.0])}
    rows = Rows(np.array([[0.0, 1.0]]), np.array([-2.0]))
    x = np.array([0.0, 0.0, 0.3, 0.0])
    result = parts(0.0, x, known, np.array([4.0, 4.0]), rows)
    assert result.u[1] <= -2.0 + 1e-6
    alone = parts(0.0, x, known, np.array([4.0, 4.0]))
    assert result.u[0] <= alone.u[0] + 1e-3


def test_a_whole_row_that_own_parts_forbid_is_violated_least_inside_them():
    parts = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5)
    known = {1: heard([1.6, 0.0, 0.0, 0.0])}
    x = np.array([0.0, 0.0, 0.4, 0.0])
    flee = Rows(np.array([[-1.0, 0.0]]), np.array([-3.0]))
    result = parts(0.0, x, known, np.zeros(2), flee)
    most = parts(0.0, x, known, np.array([4.0, 0.0]))
    assert result.u[0] < 3.0
    assert result.u[0] == pytest.approx(most.u[0], abs=0.02)


def test_an_obstacle_is_never_reached():
    parts = OwnParts(DRAG, {}, RADIUS, 3.5)
    rng, x = np.random.default_rng(1), np.array([-3.0, 0.2, 2.0, 0.0])
    nearest = np.inf
    for step in range(300):
        away, distance = x[:2] / np.linalg.norm(x[:2]), float(np.linalg.norm(x[:2])) - 1.0
        result = parts(0.05 * step, x, {}, 4.0 * np.sign(-x[:2]), None, [(distance, away)])
        for _ in range(5):
            time = np.array([float(rng.uniform(0.004, 0.01))])
            x = moved(x, result.u, held(np.array([DRAG.drag]), time))
            nearest = min(nearest, float(np.linalg.norm(x[:2])) - 1.0)
    assert 0.0 < nearest < 0.2
