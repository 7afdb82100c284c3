"""Own parts of agents that know one another by radio: kept, or braked, at any age."""

from dataclasses import replace

import numpy as np
import pytest

from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion
from phalanx.knowledge.own_parts import OwnParts
from phalanx.knowledge.sets import HeardState
from phalanx.knowledge.shares import after
from phalanx.theory.rows.row import Rows
from tests.unit.knowledge.adverse import box_motion, gap
from tests.unit.knowledge.swarms import RADIUS, Radio, cross, rush

PLANE = PointMotion(2, 4.0, 0.0, 0.0, longest=0.05, shortest=0.02)
DRAG = PointMotion(2, 4.0, 0.6, 0.0, longest=0.05, shortest=0.02)
SPACE = PointMotion(3, 4.0, 0.6, 0.0, longest=0.05, shortest=0.02)
DISTURBED = PointMotion(2, 4.0, 0.3, 0.1, longest=0.05, shortest=0.02)
BOX = box_motion(2, 3.0, 0.0, 0.0, 0.05, 0.02)
DISTURBED_BOX = box_motion(2, 3.0, 0.4, 0.0, 0.05, 0.02)
MEASURED_BOX = replace(DISTURBED_BOX, position_error=0.02)
MEASURED = replace(DISTURBED, disturbance=0.05, position_error=0.02, speed_error=0.02)


def heard(x, t=0.0) -> HeardState:
    x = np.array(x, dtype=float)
    return HeardState(t, x, x, t, np.zeros(len(x) // 2))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion", "radio"),
    [
        pytest.param(PLANE, Radio(0.9), id="loss .9"),
        pytest.param(DRAG, Radio(0.3, every=5, partition=(0.8, 2.0)), id="a partition, drag"),
        pytest.param(BOX, Radio(0.3, every=5, partition=(0.2, 1.2)), id="a partition, velocities"),
        pytest.param(SPACE, Radio(0.5, every=3), id="in space", marks=pytest.mark.nightly),
        pytest.param(DRAG, Radio(0.9), id="loss .9, drag", marks=pytest.mark.nightly),
        pytest.param(PLANE, Radio(), id="no loss", marks=pytest.mark.nightly),
        pytest.param(PLANE, Radio(0.3, every=5), id="loss .3", marks=pytest.mark.nightly),
    ],
)
def test_agents_that_cross_stay_apart_at_any_loss_and_no_gap_used_is_above_the_truth(motion, radio):
    above = []

    def compare(t, i, members, result):
        for l, claim in result.gaps.items():
            true = gap(members[i].x, members[l].x, motion, motion, RADIUS)
            above.append(claim - true)

    law = rush if motion in (SPACE, BOX) else None
    end = cross(5, radio, 1, motion=motion, law=law, circle=3.5, duration=3.0, observe=compare)
    assert end.least > 0.0
    assert max(above) <= 0.0


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.3, pytest.param(0.0, marks=pytest.mark.nightly)])
def test_agents_that_keep_right_arrive_where_three_of_ten_broadcasts_are_lost(loss):
    end = cross(4, Radio(loss, every=5), 2, motion=PLANE, circle=5.0, duration=20.0)
    assert end.arrived == 4
    assert end.least > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("motion", [DISTURBED, MEASURED, DISTURBED_BOX, MEASURED_BOX])
def test_disturbed_agents_stay_apart_and_none_leaves_its_tube(motion):
    rng, above, farthest = np.random.default_rng(1), [], []

    def push(member, i, t):
        # Towards the middle, and across at the rate of the tracking.
        turn = np.array([np.cos(1.5 * t + i), np.sin(1.5 * t + i)])
        inwards = -member.x[:2] / max(np.hypot(*member.x[:2]), 1e-9)
        phi = np.concatenate([inwards, (inwards + turn) * (not motion.jumps)])
        return motion.disturbance * phi / np.linalg.norm(phi)

    def measure(x):
        error = rng.normal(size=(2, 2))
        error /= np.linalg.norm(error, axis=1)[:, None]
        speed_error = 0.0 if motion.jumps else motion.speed_error
        return x + np.concatenate([motion.position_error * error[0], speed_error * error[1]])

    def compare(t, i, members, result):
        z = [after(member.parts._last, t, motion) for member in members if member.samples]
        if len(z) == len(members):
            farthest.extend(np.hypot(*(a[:2] - m.x[:2])) for a, m in zip(z, members, strict=True))
            for l, claim in result.gaps.items():
                above.append(claim - gap(z[i], z[l], motion, motion, RADIUS))

    hooks = {"push": push, "measure": measure, "observe": compare}
    radio = Radio(0.3, every=4, relays=True)
    end = cross(4, radio, 1, motion=motion, law=rush, circle=3.0, duration=3.0, **hooks)
    assert end.least > 0.0
    assert max(above) <= 0.0
    assert 0.3 * motion.tube < max(farthest) <= motion.tube


@pytest.mark.slow
def test_a_disturbed_agent_that_has_braked_holds_its_place():
    parts, rng = OwnParts(DISTURBED, {1: DISTURBED}, RADIUS, 3.5), np.random.default_rng(2)
    x, places, drag = np.array([0.0, 0.0, 1.0, 0.5]), [], np.array([DISTURBED.drag])
    phi = 0.1 * np.array([0.6, 0.0, 0.8, 0.0])
    for step in range(300):
        u = parts(0.05 * step, x, {}, np.array([4.0, 4.0])).u
        for _ in range(5):
            x = moved(x, u + phi[2:], held(drag, np.array([0.01])))
            x[:2] += 0.01 * phi[:2]
        places.append(x[:2])
        if rng.random() < 0.1:
            phi = -phi
    at_rest = np.array(places[100:])
    middle = 0.5 * (at_rest.min(axis=0) + at_rest.max(axis=0))
    assert np.linalg.norm(at_rest - middle, axis=1).max() <= DISTURBED.tube


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
    assert then.binding == ()
    assert set(then.gaps) == set(then.sets) == {1, 2}


def test_a_wish_that_spends_too_much_gives_way_and_the_peer_is_named():
    parts = OwnParts(PLANE, {3: PLANE, 7: PLANE}, RADIUS, 3.5)
    known = {3: heard([9.0, 9.0, 0.0, 0.0]), 7: heard([1.5, 0.0, 0.0, 0.0])}
    result = parts(0.0, np.array([0.0, 0.0, 0.5, 0.0]), known, np.array([4.0, 0.5]))
    assert result.u[0] < 3.0
    assert result.binding == (7,)


def test_no_more_than_one_over_e_tau_is_spent_however_large_kappa_is():
    known, x = {1: heard([1.4, 0.0, 0.0, 0.0])}, np.array([0.0, 0.0, 0.2, 0.0])
    motions = PLANE, {1: replace(PLANE, longest=0.1)}
    inputs = [
        OwnParts(*motions, RADIUS, kappa)(0.0, x, known, np.array([4.0, 0.0])).u[0]
        for kappa in (1.0 / (np.e * 0.1), 50.0, 1.0)
    ]
    assert inputs[0] == pytest.approx(inputs[1], abs=1e-9)
    assert inputs[2] < inputs[1] < 4.0


def test_a_peer_that_was_heard_long_ago_makes_an_agent_brake():
    parts = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5)
    x = np.array([0.0, 0.0, 1.0, 0.0])
    result = parts(9.0, x, {1: heard([4.0, 0.0, 0.0, 0.0])}, np.array([4.0, 0.0]))
    assert result.gaps[1] < 0.0
    assert result.u[0] <= -3.0


def test_what_is_not_a_number_makes_an_agent_brake():
    x, wish = np.array([0.0, 0.0, 1.0, 0.0]), np.array([4.0, 0.0])
    far = {1: heard([90.0, 0.0, 0.0, 0.0]), 2: heard([-90.0, 0.0, 0.0, 0.0])}
    for known, wished in [
        ({**far, 2: heard([np.nan, 0.0, 0.0, 0.0])}, wish),
        ({**far, 1: heard([90.0, 0.0, np.nan, 0.0])}, wish),
        (far, np.array([np.nan, 0.0])),
    ]:
        parts = OwnParts(PLANE, {1: PLANE, 2: PLANE}, RADIUS, 3.5)
        result = parts(0.0, x, known, wished)
        assert result.braked
        np.testing.assert_array_equal(result.u, PLANE.brake(x[2:]))


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


@pytest.mark.slow
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
