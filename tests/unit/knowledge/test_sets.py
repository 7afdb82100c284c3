"""Sets of a peer's reference: no input leads out of them, and one leads to each corner."""

import numpy as np
import pytest

from phalanx.knowledge.motion import PointMotion, stacked
from phalanx.knowledge.sets import Boxes
from tests.unit.knowledge.adverse import DRAWS, draw_inputs, draw_states, enclosed, gap, path

AWAY = 1e-9


@pytest.mark.parametrize("draw", DRAWS)
@pytest.mark.parametrize("kind", ["random", "bang-bang"])
def test_a_set_contains_the_peer_whatever_its_inputs_were(kind, draw):
    rng = np.random.default_rng(1)
    for _ in range(150):
        motion, age = draw(rng), float(rng.uniform(0.0, 2.0))
        (z,) = draw_states(motion, 1, rng)
        low, high = enclosed(z, age, motion)
        *_, there = path(z, draw_inputs(kind, 16, motion, rng), age, motion)
        assert (low[0] - AWAY <= there).all()
        assert (there <= high[0] + AWAY).all()


def test_one_input_reaches_the_far_end_of_place_and_speed():
    motion, z = PointMotion(2, 3.0, 0.4, 0.0, longest=0.05, shortest=0.03), np.zeros(4)
    _, high = enclosed(z, 1.5, motion)
    *_, there = path(z, np.full((1, 2), 3.0), 1.5, motion)
    np.testing.assert_allclose(high[0], there)


@pytest.mark.slow
@pytest.mark.parametrize("draw", DRAWS)
def test_a_set_contains_the_peer_whatever_the_error_of_the_stamp(draw):
    rng = np.random.default_rng(3)
    for _ in range(150):
        motion, error = draw(rng), 0.1
        (z,), age = 3.0 * draw_states(motion, 1, rng), float(rng.uniform(0.0, 1.0))
        low, high = enclosed(z, age, motion, stamp_error=error)
        true_age = max(0.0, age + float(rng.uniform(-error, error)))
        *_, there = path(z, draw_inputs("bang-bang", 16, motion, rng), true_age, motion)
        assert (low[0] - AWAY <= there).all()
        assert (there <= high[0] + AWAY).all()


@pytest.mark.slow
@pytest.mark.parametrize("draw", DRAWS)
def test_a_gap_by_a_set_is_never_above_the_true_one(draw):
    rng, closest = np.random.default_rng(4), np.inf
    for _ in range(150):
        motion, age = draw(rng), float(rng.uniform(0.0, 1.0))
        z, own = draw_states(motion, 2, rng)
        own[: motion.axes] *= 6.0
        boxes = enclosed(z, age, motion)
        claim = boxes.distance(own[: motion.axes]) - 1.0
        claim -= motion.stopping(float(np.linalg.norm(own[motion.axes :])))
        claim -= stacked([motion]).stopping(boxes.speed())
        towards = own[: motion.axes] - z[: motion.axes]
        inputs = np.sign(towards) * np.full((4, motion.axes), motion.authority)
        *_, there = path(z, inputs, age, motion)
        true = gap(own, there, motion, motion, 1.0)
        assert claim[0] <= true + AWAY
        closest = min(closest, true - claim[0])
    assert closest < 0.5, "claims are near the truth where the peer comes as fast as it can"


@pytest.mark.parametrize("draw", DRAWS)
def test_what_happens_until_a_time_is_within_the_swept_box(draw):
    rng = np.random.default_rng(5)
    for _ in range(100):
        motion, time = draw(rng), float(rng.uniform(0.0, 1.0))
        (z,) = draw_states(motion, 1, rng)
        swept = Boxes(z[None], z[None]).within(np.array([time]), stacked([motion]))
        for there in path(z, draw_inputs("bang-bang", 16, motion, rng), time, motion):
            assert (swept.low[0] - AWAY <= there).all()
            assert (there <= swept.high[0] + AWAY).all()
