"""Shares: gaps to peers that keep their half, above those by sets and never above the truth."""

import numpy as np
import pytest

from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion, stacked
from phalanx.knowledge.own_parts import OwnParts
from phalanx.knowledge.sets import HeardState, enclosures
from phalanx.knowledge.shares import Hold, Shares, after
from tests.unit.knowledge.adverse import box_motion, enclosed, gap
from tests.unit.knowledge.swarms import RADIUS, Radio, cross, keep_right, rush

PLANE = PointMotion(2, 4.0, 0.0, 0.0, longest=0.05, shortest=0.02)
DRAG = PointMotion(2, 4.0, 0.6, 0.0, longest=0.05, shortest=0.02)
BOX = box_motion(2, 3.0, 0.0, 0.0, 0.05, 0.02)
AWAY = np.array([50.0, 0.0, 0.0, 0.0])


def heard(x, t, t_apply=None) -> HeardState:
    x = np.array(x, dtype=float)
    return HeardState(t, x, x, t if t_apply is None else t_apply, np.zeros(2))


def gap_by_set(own, peer_set, motion) -> float:
    p, v, (low, high, _) = own[:2], own[2:], peer_set
    apart = np.hypot(*np.maximum(0.0, np.maximum(low[:2] - p, p - high[:2])))
    speed = np.hypot(*np.maximum(-low[2:], high[2:]))
    return apart - RADIUS - motion.stopping(np.hypot(*v)) - motion.stopping(speed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "motion"),
    [
        pytest.param(rush, DRAG, id="rush, drag"),
        pytest.param(rush, BOX, id="rush, velocities"),
        pytest.param(rush, PLANE, id="rush", marks=pytest.mark.nightly),
        pytest.param(keep_right(3.0), PLANE, id="keep right", marks=pytest.mark.nightly),
    ],
)
def test_a_share_is_never_above_the_true_gap_however_hard_agents_press(law, motion):
    above, larger = [], 0

    def compare(t, i, members, result):
        nonlocal larger
        for l, claim in result.gaps.items():
            above.append(claim - gap(members[i].x, members[l].x, motion, motion, RADIUS))
            larger += claim > gap_by_set(members[i].x, result.sets[l], motion) + 1e-6

    radio = Radio(0.5, every=4, relays=True)
    end = cross(4, radio, 3, motion=motion, law=law, circle=3.5, duration=3.0, observe=compare)
    assert end.least > 0.0
    assert max(above) <= 0.0
    assert max(above) > -0.05, "some claims are near the truth"
    assert larger > 0.4 * len(above)


def gap_at(state: HeardState, samples: int) -> tuple[float, float]:
    """The gap claimed at the last of an agent's samples, each 40 ms, and that by the set.

    The agent rests at the origin; before the state is heard, its peer was far away.
    """
    parts, t = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5), 0.0
    for sample in range(samples):
        t = 0.04 * sample
        known = heard(AWAY, -1.0) if t < state.t else state
        claim = parts(t, np.zeros(4), {1: known}, np.zeros(2)).gaps[1]
    box = enclosed(state.z, t - state.t, PLANE)
    return claim, gap_by_set(np.zeros(4), (box.low[0], box.high[0], 0.0), PLANE)


def test_of_a_gap_between_agents_at_rest_a_share_by_age_is_left():
    claim, by_set = gap_at(heard([3.0, 0.0, 0.0, 0.0], 0.3), samples=24)
    half = 0.5 * 3.5
    assert claim == pytest.approx(2.0 * (1.0 - half * 0.05) ** 12 * (1.0 - half * 0.02), abs=1e-6)
    assert by_set < 0.0


@pytest.mark.parametrize(
    "state",
    [heard([3.0, 0.0, 0.0, 0.0], 0.3, t_apply=0.31), heard([3.0, 0.0, 0.0, 1.0], 0.0)],
    ids=["its input applies later", "it started in motion"],
)
def test_a_peer_that_may_act_on_an_older_gap_has_no_share(state):
    claim, by_set = gap_at(state, samples=24)
    assert claim == pytest.approx(by_set, abs=1e-6)


def test_after_a_restart_there_is_no_share_of_what_was_heard_before():
    state = heard([3.0, 0.0, 0.0, 0.0], 0.3)
    parts = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5)
    for t in (0.86, 0.9):
        claim = parts(t, np.zeros(4), {1: state}, np.zeros(2)).gaps[1]
        box = enclosed(state.z, t - 0.3, PLANE)
        by_set = gap_by_set(np.zeros(4), (box.low[0], box.high[0], 0.0), PLANE)
        assert claim == pytest.approx(by_set, abs=1e-6)


def test_an_agent_that_is_not_where_its_input_leads_has_no_share():
    state = heard([3.0, 0.0, 0.0, 0.0], 0.3)
    parts = OwnParts(PLANE, {1: PLANE}, RADIUS, 3.5)
    for t in np.arange(0.2, 0.96, 0.04):
        x = np.array([0.01 * (t > 0.9), 0.0, 0.0, 0.0])
        claim = parts(t, x, {1: state}, np.zeros(2)).gaps[1]
    box = enclosed(state.z, t - 0.3, PLANE)
    by_set = gap_by_set(x, (box.low[0], box.high[0], 0.0), PLANE)
    assert claim == pytest.approx(by_set, abs=1e-6)


@pytest.mark.slow
def test_an_agent_that_backs_off_and_comes_back_counts_what_its_peer_used_meanwhile():
    motions, x = {0: PLANE, 1: PLANE}, np.array([[0.0, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0]])
    parts = [OwnParts(PLANE, {1 - i: motions[1 - i]}, RADIUS, 3.5) for i in range(2)]
    state, left = heard(x[1], 0.0), []
    for sample in range(50):
        t = 0.05 * sample
        back = -4.0 if t < 0.5 else 4.0 if t < 1.5 else -4.0
        mine = parts[0](t, x[0], {1: state}, np.array([back if t < 2.0 else 0.0, 0.0]))
        rushing = parts[1](t, x[1], {0: heard(x[0], t)}, np.array([-4.0, 0.0]))
        left.append(gap(x[0], x[1], PLANE, PLANE, RADIUS) - mine.gaps[1])
        inputs = np.array([mine.u, rushing.u])
        x = moved(x, inputs, held(np.array([0.0]), np.array([0.05])))
    assert min(left) >= 0.0


def test_a_share_of_a_peer_that_rests_falls_by_no_less_than_the_way_closed_in():
    rng, tightest = np.random.default_rng(4), np.inf
    for _ in range(40):
        drag = float(rng.choice([0.0, 0.6]))
        motion = PointMotion(2, 4.0, drag, 0.0, longest=0.05, shortest=0.02)
        shares = Shares(motion, RADIUS, share=0.0, stamp_error=0.0, enclose=enclosures)
        z, t = np.concatenate([np.zeros(2), rng.normal(size=2)]), 0.0
        state = heard([2.0 + 2.0 * rng.random(), rng.normal(), 0.0, 0.0], 0.01)
        for _ in range(5):
            u, end = rng.choice([-4.0, 4.0], 2), t + float(rng.uniform(0.02, 0.05))
            shares.remember(Hold(t, z, u, end))
            z, t = after(Hold(t, z, u, end), end, motion), end
        claim = shares.gaps(t, z, [state], stacked([motion]))[0]
        true = gap(z, state.z, motion, motion, RADIUS)
        assert claim <= true
        tightest = min(tightest, true - claim)
    assert tightest < 0.01


def test_a_share_is_the_same_to_the_bit_however_often_it_was_asked_for_before():
    rng, motions, finite = np.random.default_rng(7), stacked([PLANE, DRAG]), 0
    states = [heard([9.0, 0.0, 0.0, 0.0], 0.0), heard([0.0, 12.0, 0.0, 0.0], 0.0)]
    asked, z, t, holds = Shares(DRAG, RADIUS, 1.5, 0.001, enclosures), 0.2 * np.ones(4), 0.0, []
    for sample in range(60):
        hold = Hold(t, z, rng.uniform(-4.0, 4.0, 2), t + float(rng.uniform(0.02, 0.05)))
        holds, t, z = [*holds, hold], hold.end, after(hold, hold.end, DRAG)
        asked.remember(hold)
        if sample % 9 == 5:
            states[sample % 2] = heard([9.0, 3.0, 0.0, 0.5], t - 0.03)
        near = [0, 1] if sample % 4 else [1]
        gaps = asked.gaps(t, z, [states[n] for n in near], motions.of(near))
        unasked = Shares(DRAG, RADIUS, 1.5, 0.001, enclosures)
        for hold in holds:
            unasked.remember(hold)
        once = unasked.gaps(t, z, [states[n] for n in near], motions.of(near))
        np.testing.assert_array_equal(gaps, once)
        finite += int(np.isfinite(gaps).sum())
    assert finite > 60
