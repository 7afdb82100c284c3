"""The input nearest to a wish inside own parts, whole rows violated least, against a grid."""

from typing import NamedTuple

import numpy as np
import pytest

from phalanx.knowledge.choice import InputChoice, Limits
from phalanx.knowledge.cones import cones, everywhere, fixed, joined, own_motion
from phalanx.knowledge.motion import PointMotion, stacked
from phalanx.knowledge.sets import Boxes
from phalanx.knowledge.spending import HoldPieces
from phalanx.theory.rows.row import Rows
from tests.unit.knowledge.adverse import enclosed

PLANE = PointMotion(2, 4.0, 0.0, 0.0, longest=0.05, shortest=0.02)
HOLD = HoldPieces(PLANE, 4)
CHOICE = InputChoice(PLANE, HOLD)
_LINE = np.linspace(-4.0, 4.0, 81)
GRID = np.array(np.meshgrid(_LINE, _LINE)).reshape(2, -1).T


class Scene(NamedTuple):
    """A speed, limits by peers around, a wish and whole rows."""

    v: np.ndarray
    limits: Limits
    wish: np.ndarray
    whole: Rows | None


def draw_scene(rng: np.random.Generator, rows: int) -> Scene:
    """Up to four peers around an agent, heard lately or some time ago."""
    v, count = rng.normal(size=2) * rng.choice([0.05, 0.5, 2.0]), int(rng.integers(1, 5))
    boxes = []
    for angle in rng.uniform(0.0, 2.0 * np.pi, count):
        way = rng.uniform(1.2, 5.0) * np.array([np.cos(angle), np.sin(angle)])
        z = np.concatenate([way, rng.normal(size=2)])
        boxes.append(enclosed(z, float(rng.choice([0.05, 0.3, 0.6])), PLANE))
    peers = Boxes(*(np.concatenate(column) for column in zip(*boxes, strict=True)))
    own = own_motion(np.concatenate([np.zeros(2), v]), PLANE)
    around = cones(own, peers, stacked([PLANE] * count), HOLD.times)
    limits = Limits(around, rng.choice([0.0, 0.2, 1.0, 2.0], count))
    whole = Rows(rng.normal(size=(rows, 2)), rng.uniform(-6.0, 3.0, rows)) if rows else None
    return Scene(v, limits, 4.0 * rng.normal(size=2), whole)


def allowed(scene: Scene, u: np.ndarray) -> np.ndarray:
    return (HOLD.spending(scene.v, u, scene.limits.cones) <= scene.limits.most).all(axis=1)


def worst(whole: Rows, u: np.ndarray) -> np.ndarray:
    return np.maximum(0.0, (u @ whole.a.T - whole.bound).max(axis=1))


@pytest.mark.slow
def test_an_input_is_allowed_or_the_brake_and_almost_as_near_to_the_wish_as_any():
    rng, farther = np.random.default_rng(1), []
    for _ in range(60):
        scene = draw_scene(rng, rows=0)
        u, braked, _ = CHOICE.nearest(scene.wish, scene.v, scene.limits, None)
        assert braked or allowed(scene, u[None])[0]
        inside = GRID[allowed(scene, GRID)]
        if len(inside):
            nearest = np.linalg.norm(inside - scene.wish, axis=1).min()
            farther.append(np.linalg.norm(u - scene.wish) - nearest)
    assert np.quantile(farther, 0.9) < 0.05
    assert len(farther) > 50


@pytest.mark.slow
def test_whole_rows_are_kept_if_an_allowed_input_keeps_them_and_violated_least_if_none_does():
    rng, more, kept = np.random.default_rng(2), [], 0
    for number in range(80):
        scene = draw_scene(rng, rows=1 + number % 3)
        u, braked, _ = CHOICE.nearest(scene.wish, scene.v, scene.limits, scene.whole)
        assert braked or allowed(scene, u[None])[0]
        inside = GRID[allowed(scene, GRID)]
        if len(inside):
            least = worst(scene.whole, inside).min()
            more.append(worst(scene.whole, u[None])[0] - least)
            kept += least == 0.0
    assert np.quantile(more, 0.9) < 0.05
    assert kept > 10
    assert kept < len(more) - 10


def test_the_row_that_keeps_an_input_from_the_wish_is_named():
    ahead, behind = np.array([[-1.0, 0.0]]), np.array([[1.0, 0.0]])
    limits = Limits(fixed(np.concatenate([behind, ahead]), 4), np.array([0.6, 0.6]))
    wish, v = np.array([4.0, 0.0]), np.array([0.5, 0.0])
    u, braked, binding = CHOICE.nearest(wish, v, limits, None)
    assert (braked, binding) == (False, (1,))
    assert u[0] < 4.0


def test_only_the_brake_is_left_where_peers_may_be_everywhere():
    limits = Limits(joined([everywhere(2, 4, 2)]), np.zeros(2))
    u, braked, _ = CHOICE.nearest(np.array([4.0, 1.0]), np.zeros(2), limits, None)
    assert braked
    np.testing.assert_array_equal(u, np.zeros(2))
