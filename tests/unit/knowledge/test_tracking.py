"""The tube around a reference: no disturbance and no order of gaps leads out of it."""

from itertools import pairwise

import numpy as np
import pytest

from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion
from phalanx.knowledge.tracking import tracking

SUBSTEPS = 8
CASES = {
    "short gaps": PointMotion(2, 4.0, 0.0, 0.1, longest=0.05, shortest=0.02),
    "drag": PointMotion(3, 6.0, 0.56, 0.2, longest=0.12, shortest=0.1),
    "measured": PointMotion(2, 4.0, 0.3, 0.05, 0.08, 0.03, position_error=0.02, speed_error=0.05),
}


def transition(motion: PointMotion, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Φ, G: an error becomes Φ e + G u after a time; shapes (2, 2), (2,)."""
    decay, k, reach = (float(f) for f in held(np.array(motion.drag), np.array(time)))
    return np.array([[1.0, k], [0.0, decay]]), np.array([reach, k])


def worst_error(motion: PointMotion, gaps: np.ndarray, until: float, c: np.ndarray) -> float:
    """The largest c·e some time into the last of these gaps, over all φ and measured errors.

    The exact adjoint: φ turns with it, at each of the substeps that a gap is cut into.
    """
    K = -np.array(motion.tracking.gains)
    pull = motion.tracking.gains[0] * motion.position_error
    pull += abs(motion.tracking.gains[1]) * motion.speed_error
    total, adjoint = 0.0, np.array(c, dtype=float)
    for gap in [until, *gaps[::-1]]:
        phi, G = transition(motion, gap)
        for time in (np.arange(SUBSTEPS) + 0.5) * gap / SUBSTEPS:
            later, _ = transition(motion, time)
            total += np.linalg.norm(later.T @ adjoint) * motion.disturbance * gap / SUBSTEPS
        total += abs(G @ adjoint) * pull
        adjoint = (phi + np.outer(G, K)).T @ adjoint
    return total


def draw_gaps(motion: PointMotion, kind: str, rng: np.random.Generator) -> np.ndarray:
    """Gaps of the clock: all long, all short, or at random."""
    if kind == "random":
        return rng.uniform(motion.shortest, motion.longest, 120)
    return np.full(120, motion.longest if kind == "long" else motion.shortest)


@pytest.mark.slow
@pytest.mark.parametrize("motion", CASES.values(), ids=CASES)
def test_no_disturbance_leads_out_of_the_tube_whatever_the_gaps(motion):
    rng, closest, tracked = np.random.default_rng(1), 0.0, motion.tracking
    for kind in ("long", "short", "random"):
        gaps = draw_gaps(motion, kind, rng)
        for until in (0.0, 0.3 * motion.longest, motion.longest):
            place = worst_error(motion, gaps, until, [1.0, 0.0])
            assert place <= tracked.tube
            assert worst_error(motion, gaps, until, [0.0, 1.0]) <= tracked.speed_tube
            closest = max(closest, place / tracked.tube)
    assert closest > 0.4, "the bound is not far above what can be"


@pytest.mark.parametrize("motion", CASES.values(), ids=CASES)
def test_tracking_takes_no_more_of_an_input_than_its_reserve(motion):
    rng, tracked = np.random.default_rng(2), motion.tracking
    pull = tracked.gains[0] * motion.position_error
    pull += abs(tracked.gains[1]) * motion.speed_error
    for kind in ("long", "short", "random"):
        gaps = draw_gaps(motion, kind, rng)
        most = worst_error(motion, gaps, 0.0, np.array(tracked.gains)) + pull
        assert most <= tracked.reserve < motion.acceleration
    assert motion.authority == motion.acceleration - tracked.reserve


def test_without_disturbance_there_is_no_tube():
    motion = PointMotion(2, 4.0, 0.3, 0.0, longest=0.05, shortest=0.02)
    assert (motion.tube, motion.authority) == (0.0, 4.0)


def test_a_disturbance_that_the_input_cannot_hold_a_place_against_is_an_error():
    with pytest.raises(ValueError, match=r"disturbance of 2 takes [0-9.]+ m/s² of each.*has 4"):
        tracking(0.0, 2.0, 0.05, 0.02, 4.0)


def test_a_larger_disturbance_has_a_wider_tube_and_a_larger_reserve():
    bounds = [tracking(0.0, phi, 0.05, 0.02, 4.0) for phi in (0.01, 0.1, 0.3)]
    for less, more in pairwise(bounds):
        assert less.tube < more.tube
        assert less.reserve < more.reserve


FACTORS = [(0.0, 0.3), (1e-9, 2.0), (0.56, 0.05), (0.56, 3.0), (2.0, 15.0), (3.0, 500.0)]


@pytest.mark.parametrize(("drag", "time"), FACTORS)
def test_factors_are_those_of_the_exact_solution(drag, time):
    factors = held(np.array([drag]), np.array([time]))
    k = -np.expm1(-drag * time) / drag if drag else time
    small = drag * time < 1e-4
    reach = time**2 / 2 * (1 - drag * time / 3) if small else (time - k) / drag
    assert factors.decay == pytest.approx(np.exp(-drag * time), rel=1e-12, abs=1e-16)
    assert factors.speed == pytest.approx(k, rel=1e-13)
    assert factors.reach == pytest.approx(reach, rel=1e-12)


def test_two_holds_after_one_another_are_one_of_their_sum():
    x, u, drag = np.array([1.0, -2.0, 0.5, 3.0]), np.array([0.7, -4.0]), np.array([0.8])
    twice = x
    for time in (0.3, 1.1):
        twice = moved(twice, u, held(drag, np.array([time])))
    np.testing.assert_allclose(twice, moved(x, u, held(drag, np.array([1.4]))), rtol=1e-13)
