"""Tubes of *hold* contain every motion that they promise to contain, and so does W."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.knowledge.motion import PointMotion
from phalanx.knowledge.velocity import VelocityMotion
from phalanx.promise.capsules import balls
from phalanx.promise.hold import STILL, hold
from phalanx.theory.models.polytope import polytope
from tests.unit.knowledge.adverse import box_motion
from tests.unit.promise.members import disc, member, run

SQUARE = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.array([2.0, 0.5, 2.0, 0.5]))
UNICYCLE = VelocityMotion(SQUARE, 0.1, 2.0, longest=0.06, shortest=0.04)
MOTIONS = {
    "velocities": box_motion(2, 1.5, 0.2, 0.0, 0.06, 0.02),
    "velocities in space": box_motion(3, 1.5, 0.2, 0.0, 0.06, 0.02),
    "a unicycle": UNICYCLE,
    "brake": PointMotion(2, 4.0, 0.0, 0.0, 0.05, 0.02),
    "brake, pushed": PointMotion(2, 4.0, 0.0, 0.3, 0.05, 0.02),
    "brake, pushed, with drag": PointMotion(2, 4.0, 1.5, 0.3, 0.05, 0.02),
    "brake in space": PointMotion(3, 2.0, 0.5, 0.1, 0.05, 0.03),
}


def drawn_push(rng: np.random.Generator, axes: int):
    """One direction of φ for all time, now and then another one, and one turn."""
    turn = float(rng.choice([-1.0, 1.0]))
    state = {"phi": None, "until": -1.0}

    def push(m, members, t):
        if t > state["until"]:
            phi = rng.normal(size=2 * axes)
            if m.motion.jumps:
                phi[axes:] = 0.0
            state.update(phi=phi / np.linalg.norm(phi), until=t + float(rng.choice([0.03, 9.0])))
        return state["phi"], turn

    return push


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTIONS)
@settings(max_examples=5)
@given(seed=st.integers(0, 10**6))
def test_an_agent_stays_in_its_tube_and_in_what_others_expect_of_it(name, seed):
    rng, motion = np.random.default_rng(seed), MOTIONS[name]
    axes = motion.axes
    x = np.zeros(2 * axes)
    if not motion.jumps:
        x[axes:] = rng.uniform(-2.0, 2.0, axes)
    agent = member(motion, x)
    # Obstacles all around: the first input is applied, all later ones are the fallback's.
    u = motion.authority * rng.choice([-1.0, 0.3, 1.0], axes)
    if motion.jumps:
        u = u * min(1.0, motion.inputs.b.min() / max(np.abs(u).max(), 1e-9))
    agent.u = u
    way, expected = [], []

    def look(t):
        way.append(agent.p)
        if len(way) % 16 == 1:
            expected.append((len(way), agent.commitment.fallback.expected(agent.x[None])))

    blocked = lambda *_: disc(agent.p, 0.0)  # noqa: E731
    push = drawn_push(rng, axes)
    run([agent], 1.2, rng, lambda *_: 9.0 * np.ones(axes), push, blocked, look)
    assert agent.wishes == 0
    on_the_way = balls(np.array(way), np.zeros(len(way)))
    assert agent.commitment.fallback.tube(x, u).gaps(on_the_way).max() <= 0.0
    for begin, capsule in expected:
        assert capsule.gaps(on_the_way)[begin:].max(initial=-1.0) <= 0.0


@pytest.mark.parametrize("name", ["brake", "brake, pushed", "brake in space", "a unicycle"])
def test_an_agent_stands_when_its_fallback_says(name):
    rng, motion = np.random.default_rng(0), MOTIONS[name]
    axes = motion.axes
    agent = member(motion, [] if motion.jumps else [*np.zeros(axes), *np.full(axes, 2.0)])
    agent.u = np.full(axes, motion.authority if not motion.jumps else 0.4)
    time = agent.commitment.fallback.rest_time(agent.x, agent.u)
    push, blocked = drawn_push(rng, axes), lambda *_: disc(agent.p, 0.0)
    run([agent], time + motion.longest, rng, lambda *_: np.zeros(axes), push, blocked)
    speed = np.linalg.norm(agent.commitment.reference.z[axes:])
    assert speed <= STILL


def test_what_cannot_be_held_is_refused_with_both_numbers():
    with pytest.raises(ValueError, match=r"against a disturbance of 1\.73 m/s"):
        hold(VelocityMotion(SQUARE, 1.73, 2.0, 0.06, 0.04))
    with pytest.raises(ValueError, match="m/s² of each input, which has 2"):
        hold(PointMotion(2, 2.0, 0.0, 3.0, 0.05, 0.02))


def test_others_expect_at_least_every_tube():
    rng = np.random.default_rng(3)
    for motion in MOTIONS.values():
        axes, fallback = motion.axes, hold(motion)
        for _ in range(20):
            x = np.zeros(2 * axes)
            x[axes:] = 0.0 if motion.jumps else rng.uniform(-2.0, 2.0, axes)
            u = motion.inputs.corners[rng.integers(len(motion.inputs.corners))]
            tube, expected = fallback.tube(x, u), fallback.expected(x[None])
            if motion.jumps:
                assert expected.gaps(tube).max() <= -2.0 * tube.radius.max() + 1e-5
            ends = np.concatenate([tube.begin, tube.end])
            gaps = expected.gaps(
                disc(ends[0], 0.0)._replace(begin=ends, end=ends, radius=np.zeros(len(ends)))
            )
            assert gaps.max() <= 0.0
