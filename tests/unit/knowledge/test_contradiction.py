"""Contradictions: none between true states, whatever moved them; one where a state is false."""

from dataclasses import replace

import numpy as np
import pytest

from phalanx.knowledge.contradiction import contradiction
from phalanx.knowledge.motion import PointMotion
from phalanx.knowledge.sets import HeardState
from tests.unit.knowledge.adverse import (
    DRAWS,
    box_motion,
    draw_inputs,
    draw_motion,
    draw_states,
    path,
)

ROBOT = PointMotion(2, 4.0, 0.0, 0.0, longest=0.05, shortest=0.02)


def state(t: float, x: np.ndarray) -> HeardState:
    return HeardState(t, x, x, t, np.zeros(len(x) // 2))


def on_sphere(size: float, axes: int, rng: np.random.Generator) -> np.ndarray:
    """A vector on the sphere of this size."""
    direction = rng.normal(size=axes)
    return size * direction / np.linalg.norm(direction)


@pytest.mark.parametrize("draw", DRAWS)
@pytest.mark.parametrize("kind", ["random", "bang-bang"])
def test_true_states_never_contradict_one_another(kind, draw):
    rng, parts = np.random.default_rng(5), 16
    for n in range(300):
        if n % 30 == 0:
            drawn, phi = draw(rng), float(rng.uniform(0.0, 0.1))
            errors = {"position_error": 0.05} | ({} if drawn.jumps else {"speed_error": 0.1})
            motion = replace(drawn, disturbance=phi, **errors)
        axes, time = drawn.axes, float(rng.uniform(0.0, 2.0))
        (begin,), stamps = 3.0 * draw_states(drawn, 1, rng), rng.uniform(-0.02, 0.02, 2)
        pushed = on_sphere(phi, 2 * axes, rng)  # φ, of p and of v
        if drawn.jumps:
            pushed[axes:] = 0.0
        *_, end = path(begin, draw_inputs(kind, parts, drawn, rng) + pushed[axes:], time, motion)
        end[:axes] += pushed[:axes] * time
        sizes = motion.position_error, motion.speed_error
        errors = [np.concatenate([on_sphere(a, axes, rng) for a in sizes]) for _ in range(2)]
        older, newer = (
            state(t + stamp, x + error)
            for t, stamp, x, error in zip((0.0, time), stamps, (begin, end), errors, strict=True)
        )
        assert contradiction(motion, older, newer, stamp_error=0.02) <= 0.0


@pytest.mark.parametrize("stamps", [(0.02, -0.02), (-0.02, 0.02)])
@pytest.mark.parametrize(("speed", "drag"), [(30.0, 1.5), (2.0, 15.0)])
def test_one_that_coasts_with_drag_does_not_contradict_itself_by_its_stamps(speed, drag, stamps):
    motion, begin = PointMotion(2, 0.01, drag, 0.0, longest=0.05, shortest=0.02), np.zeros(4)
    begin[2] = speed
    for time in (0.1, 0.3, 1.0):
        (end,) = path(begin, np.zeros((1, 2)), time, motion)
        older, newer = state(stamps[0], begin), state(time + stamps[1], end)
        assert contradiction(motion, older, newer, stamp_error=0.02) <= 0.0


def test_the_ends_of_larger_inputs_do():
    rng = np.random.default_rng(6)
    for motion in (draw for draw in [draw_motion(rng) for _ in range(10)] for _ in range(20)):
        begin, time = rng.normal(size=2 * motion.axes), float(rng.uniform(0.2, 2.0))
        signs = np.where(np.arange(8)[:, None] < rng.integers(0, 9, motion.axes), 1.0, -1.0)
        for share, contradicts in ((0.999, False), (1.02, True)):
            *_, end = path(begin, share * motion.authority * signs, time, motion)
            assert (contradiction(motion, state(0.0, begin), state(time, end)) > 0.0) == contradicts


def test_only_a_way_longer_than_a_velocity_allows_contradicts_where_inputs_are_velocities():
    motion, begin = box_motion(2, 2.0, 0.0, 0.0, 0.05, 0.02), np.zeros(4)
    for way, contradicts in ((0.99, False), (1.01, True)):
        end = np.array([0.6 * way, -0.6 * way, 0.0, 0.0])
        assert (contradiction(motion, state(0.0, begin), state(0.3, end)) > 0.0) == contradicts


def test_a_jump_a_stop_of_the_place_alone_the_past_and_a_drift_contradict():
    """The robot drives at 2 m/s, along x."""
    before, places = [0.0, 0.0, 2.0, 0.0], {
        "true": ([0.7, 0.0], False),
        "jump": ([1.2, 0.0], True),
        "stop": ([0.0, 0.0], True),
        "past": ([-0.35, 0.0], True),
        "drift of 0.5 m/s": ([0.7, 0.175], True),
        "drift of 0.1 m/s": ([0.7, 0.035], False),
    }  # fmt: skip
    for place, contradicts in places.values():
        older, newer = state(0.0, np.array(before)), state(0.35, np.array([*place, 2.0, 0.0]))
        assert (contradiction(ROBOT, older, newer) > 0.0) == contradicts


def test_a_reference_is_in_its_tube():
    motion, x = replace(ROBOT, disturbance=0.1), np.zeros(4)
    for off, contradicts in ((0.5 * motion.tube, False), (1.0, True)):
        newer = HeardState(0.35, x, np.array([off, 0.0, 0.0, 0.0]), 0.35, np.zeros(2))
        assert (contradiction(motion, state(0.0, x), newer) > 0.0) == contradicts
