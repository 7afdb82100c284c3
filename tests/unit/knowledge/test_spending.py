"""Cones and own parts: over a whole hold no input spends more than the test says."""

import numpy as np
import pytest

from phalanx.knowledge import spending
from phalanx.knowledge.cones import cones, everywhere, fixed, joined, own_motion
from phalanx.knowledge.held import held, moved
from phalanx.knowledge.motion import PointMotion, stacked
from phalanx.knowledge.sets import Boxes
from phalanx.knowledge.spending import HoldPieces, hold_pieces
from tests.unit.knowledge.adverse import (
    DRAWS,
    draw_inputs,
    draw_motion,
    draw_states,
    enclosed,
    path,
)
from tests.unit.theory.rows.native_pieces import library_of, needs_a_compiler

AWAY = 1e-8
FINE = 64


def own_parts(motion, v, u, n, times):
    """(d/dt) L - n·v at these times, by its formula; n has shape (times, axes)."""
    if motion.jumps:
        return -(n @ u)
    factors = held(np.array([[motion.drag]]), times[:, None])
    path = factors.decay * v + factors.speed * u
    speed, faster = np.linalg.norm(path, axis=1), u - motion.drag * path
    rate = (path * faster).sum(axis=1)
    turn = np.where(speed > 0.0, rate / np.where(speed > 0.0, speed, 1.0), np.linalg.norm(u))
    return rate / motion.authority + motion.longest * turn - (n * path).sum(axis=1)


def draw_pair(rng, draw):
    """An own motion and state, a peer heard some time ago, where it is now, and its inputs."""
    motion, age = draw(rng), float(rng.uniform(0.0, 0.6))
    axes = motion.axes
    own, z = 1.5 * draw_states(motion, 2, rng)
    own[:axes] = z[:axes] + rng.normal(size=axes) * rng.choice([1.0, 3.0, 10.0])
    if rng.random() < 0.1:
        own[axes:] = 0.0
    boxes = enclosed(z, age, motion)
    *_, peer = path(z, draw_inputs("bang-bang", 8, motion, rng), age, motion)
    return motion, own, boxes, peer


@pytest.mark.slow
@pytest.mark.parametrize("draw", DRAWS)
def test_no_instant_of_a_hold_spends_more_than_the_test_says(draw):
    rng, tightest = np.random.default_rng(1), np.inf
    for _ in range(400):
        motion, own, boxes, peer = draw_pair(rng, draw)
        axes, hold = motion.axes, hold_pieces(motion, 4)
        cone = cones(own_motion(own, motion), boxes, stacked([motion]), hold.times)
        u = draw_inputs(str(rng.choice(["random", "bang-bang"])), 1, motion, rng)[0]
        claim = hold.spending(own[axes:], u[None], cone)[0, 0]
        others = draw_inputs("bang-bang", FINE, motion, rng)
        there = list(path(peer, others, motion.longest, motion))
        here = list(path(own, np.tile(u, (FINE, 1)), motion.longest, motion))
        n = np.array(here)[:, :axes] - np.array(there)[:, :axes]
        n /= np.linalg.norm(n, axis=1)[:, None]
        times = np.arange(1, FINE + 1) * motion.longest / FINE
        true = own_parts(motion, own[axes:], u, n, times).max()
        assert true <= claim + AWAY
        tightest = min(tightest, claim - true)
    assert tightest < 0.05


@pytest.mark.slow
def test_an_input_that_ends_at_rest_spends_no_more_than_the_test_says_until_it_does():
    rng, motion = np.random.default_rng(6), PointMotion(2, 5.4, 0.3, 0.0, 0.05, 0.03)
    times, hold = (np.arange(FINE) + 0.5) * motion.longest / FINE, HoldPieces(motion, 4)
    for _ in range(1500):
        v = rng.normal(size=2)
        v *= 0.9 * motion.authority * motion.longest * rng.random() / np.linalg.norm(v)
        u, away = motion.brake(v), v / np.linalg.norm(v)
        true = own_parts(motion, v, u, np.tile(away, (FINE, 1)), times).max()
        assert true <= hold.spending(v, u[None], fixed(away[None], 4))[0, 0] + AWAY


@pytest.mark.slow
@pytest.mark.parametrize("draw", DRAWS)
def test_the_direction_to_a_peer_stays_in_its_cone_throughout_each_piece(draw):
    rng, narrow = np.random.default_rng(2), 0
    for _ in range(300):
        motion, own, boxes, peer = draw_pair(rng, draw)
        axes, hold = motion.axes, hold_pieces(motion, 4)
        cone = cones(own_motion(own, motion), boxes, stacked([motion]), hold.times)
        kinds = (draw_inputs("bang-bang", FINE, motion, rng) for _ in range(2))
        here, there = (
            np.array(list(path(x, inputs, motion.longest, motion)))[:, :axes]
            for x, inputs in zip((own, peer), kinds, strict=True)
        )
        n = (here - there) / np.linalg.norm(here - there, axis=1)[:, None]
        piece = np.minimum(np.arange(FINE) * 4 // FINE, 3)
        assert ((cone.axis[0, piece] * n).sum(axis=1) >= cone.cos[0, piece]).all()
        narrow += bool((cone.cos > 0.5).all())
    assert narrow > 100


@pytest.mark.slow
def test_the_brake_spends_nothing_in_any_direction_and_needs_no_more_than_the_authority():
    rng = np.random.default_rng(3)
    for _ in range(500):
        motion = draw_motion(rng)
        v = rng.normal(size=motion.axes) * rng.choice([1e-3, 0.1, 1.0, 20.0])
        u = motion.brake(v)
        assert np.linalg.norm(u) <= motion.authority * (1.0 + 1e-12)
        times = np.linspace(0.0, motion.longest, FINE)
        factors = held(np.array([[motion.drag]]), times[:, None])
        path_v = factors.decay * v + factors.speed * u
        closing = -path_v / np.maximum(np.linalg.norm(path_v, axis=1), 1e-12)[:, None]
        assert own_parts(motion, v, u, closing, times)[:-1].max() <= 1e-9 * (1.0 + np.abs(v).max())


@pytest.mark.slow
def test_the_brake_ends_at_rest_within_the_stopping_distance():
    rng = np.random.default_rng(4)
    for _ in range(10):
        motion = draw_motion(rng)
        x = np.concatenate([np.zeros(motion.axes), 4.0 * rng.normal(size=motion.axes)])
        allowed = motion.stopping(float(np.linalg.norm(x[motion.axes :])))
        for _ in range(500):
            time = float(rng.uniform(motion.shortest, motion.longest))
            u = motion.brake(x[motion.axes :])
            x = moved(x, u, held(np.array([motion.drag]), np.array([time])))
        assert np.linalg.norm(x[: motion.axes]) <= allowed + 1e-9
        assert np.linalg.norm(x[motion.axes :]) < 1e-9


def test_boxes_that_may_contain_the_agent_leave_all_directions_open():
    rng = np.random.default_rng(5)
    motion = draw_motion(rng)
    axes = motion.axes
    box = Boxes(np.full((1, 2 * axes), -1.0), np.full((1, 2 * axes), 1.0))
    inside = np.concatenate([np.full(axes, 0.5), np.zeros(axes)])
    cone = cones(own_motion(inside, motion), box, stacked([motion]), HoldPieces(motion, 4).times)
    v = rng.normal(size=axes)
    np.testing.assert_allclose(cone.closing(v), np.linalg.norm(v))


@needs_a_compiler
@pytest.mark.slow
def test_own_parts_have_the_same_bits_in_c(tmp_path):
    compiled = spending._Compiled(library_of(spending, tmp_path))
    rng, tried = np.random.default_rng(8), 0
    while tried < 100_000:
        motion = draw_motion(rng)
        axes, count = motion.axes, int(rng.integers(1, 9))
        v = rng.normal(size=axes) * rng.choice([0.0, 1e-9, 1.0, 1e6])
        inputs = motion.authority * rng.uniform(-1.0, 1.0, (int(rng.integers(1, 20)), axes))
        inputs[rng.random(len(inputs)) < 0.2] = motion.drag * v  # of no change
        states = draw_states(motion, count, rng).reshape(count, 2 * axes)
        boxes = Boxes(states - rng.uniform(0.0, 1.0, states.shape), states)
        hold = HoldPieces(motion, int(rng.integers(1, 6)))
        own = own_motion(np.concatenate([3.0 * rng.normal(size=axes), v]), motion)
        around = cones(own, boxes, stacked([motion] * count), hold.times)
        around.cos[rng.random(around.cos.shape) < 0.02] = np.nan
        program = hold._hold, v, inputs, joined([around, everywhere(2, len(hold.times) - 1, axes)])
        np.testing.assert_array_equal(compiled(*program), spending.own_parts(*program))
        tried += len(inputs) * (count + 2)


@needs_a_compiler
@pytest.mark.parametrize(
    "change", [("last)", "first)"), ("> 0.0 ? rate", "< 0.0 ? rate"), ("along >=", "along <=")]
)
def test_c_that_computes_other_own_parts_is_refused_when_it_is_loaded(tmp_path, change):
    with pytest.raises(ValueError, match="other bits"):
        spending._Compiled(library_of(spending, tmp_path, change))
