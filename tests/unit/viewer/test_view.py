"""A camera put where it sees everything sees everything, and stands no farther than it must."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_viewer.scene.cameras import View, looks_at
from phalanx_viewer.scene.scene import _READABLE as READABLE
from phalanx_viewer.scene.texts import _LINE as LINE
from phalanx_viewer.scene.texts import LETTER
from scipy.spatial.transform import Rotation

DIRECTIONS = {
    "from above": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), 0.35),
    "at a slant": ((-0.55, -0.75, 0.6), (0.0, 0.0, 1.0), 0.8),
}
numbers = st.floats(-1e3, 1e3)
clouds = st.lists(st.tuples(numbers, numbers, numbers), min_size=1, max_size=9)


def camera(name: str, aspect: float) -> View:
    position, up, fov = DIRECTIONS[name]
    return View(np.array(position), np.zeros(3), np.array(up), fov, aspect)


@given(name=st.sampled_from(sorted(DIRECTIONS)), cloud=clouds, aspect=st.floats(0.4, 3.0))
def test_a_fitted_camera_holds_all_balls_but_no_nearer_one_does(
    name: str, cloud: list[tuple[float, ...]], aspect: float
) -> None:
    centres, reach = np.array(cloud), 2.0
    fitted = camera(name, aspect).fitted(centres, reach, edge=0.0)
    rims = np.concatenate([centres + reach * axis * s for axis in fitted.axes for s in (-1, 1)])
    nearer = replace(fitted, position=fitted.position + 0.5 * reach * fitted.axes[2])
    tangent = np.concatenate([rims, *_tangent_points(fitted, centres, reach)])
    assert replace(fitted, fov=1.0001 * fitted.fov).holds(tangent)
    assert not nearer.holds(np.concatenate([rims, *_tangent_points(nearer, centres, reach)]))


def _tangent_points(view: View, centres: np.ndarray, reach: float) -> list[np.ndarray]:
    """The points of balls that are nearest to the edges of the picture."""
    right, up, forward = view.axes
    tan = np.tan(view.fov / 2.0)
    normals = [s * right - tan * view.aspect * forward for s in (-1, 1)]
    normals += [s * up - tan * forward for s in (-1, 1)]
    return [centres + reach * n / np.linalg.norm(n) for n in normals]


@pytest.mark.parametrize("size", [(536, 736), (390, 422), (390, 714), (1280, 700), (90, 60)])
@pytest.mark.parametrize("name", sorted(DIRECTIONS))
def test_bodies_and_names_at_the_edges_of_a_fitted_picture_are_all_in_it(
    name: str, size: tuple[int, int]
) -> None:
    wide, high = size
    view = replace(camera(name, wide / high), pixels=float(min(size)))
    points = np.random.default_rng(4).uniform(-50.0, 50.0, (200, 3))
    fitted = view.fitted(points, 0.5)
    edges = np.array(size) / min(size) / 2.0
    body = 1.1 * READABLE * min(view.enlargement, 2.0)
    line, letter = (part * view.enlargement for part in (LINE, LETTER))
    right, up = np.abs(fitted.project(points)).T
    if min(size) > 300:
        assert (up + body + line <= edges[1]).all()
        assert (right + np.maximum(body, 2.0 * letter) <= edges[0]).all()
    assert fitted.holds(points)


def test_points_fall_where_the_picture_says_they_do() -> None:
    view = View(np.array([0.0, 0.0, 10.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.5, 2.0)
    side = 20.0 * np.tan(0.25)
    points = np.array([[0.0, 0.0, 0.0], [side, 0.0, 0.0], [0.0, -side / 2.0, 0.0]])
    assert view.spans(points) == pytest.approx(side)
    np.testing.assert_allclose(view.project(points), [[0, 0], [1, 0], [0, -0.5]], atol=1e-12)


def test_a_narrow_picture_is_measured_by_its_width() -> None:
    wide = camera("from above", 1.0)
    narrow = replace(wide, aspect=0.5)
    at = np.array([[0.0, 0.0, -3.0]])
    assert narrow.spans(at) == pytest.approx(0.5 * wide.spans(at))


def test_what_is_behind_the_camera_is_not_in_sight() -> None:
    view = camera("at a slant", 1.5)
    assert view.holds(view.look_at[None])
    assert not view.holds((2.0 * view.position - view.look_at)[None])


def test_a_camera_that_no_browser_can_have_is_refused() -> None:
    good = camera("at a slant", 1.5)
    assert good.possible
    nan, far = np.full(3, np.nan), np.full(3, 1e300)
    wrong = {"position": (nan, good.look_at), "look_at": (far,), "up": (good.position,)}
    for field, values in {**wrong, "fov": (0.0, 4.0)}.items():
        assert not any(replace(good, **{field: value}).possible for value in values)


def test_things_take_more_of_a_small_picture_but_never_less_of_a_large_one() -> None:
    view = camera("from above", 1.0)
    assert replace(view, pixels=155.0).enlargement == 4.0
    assert replace(view, pixels=3000.0).enlargement == 1.0


def test_a_point_pulls_a_camera_no_farther_than_its_leash() -> None:
    view = camera("from above", aspect=2.0)
    leash = 0.1 * view.spans(np.zeros((1, 3)))[0]
    near, far = np.array([0.9 * leash, 0.0, 0.0]), np.array([3.0 * leash, 0.0, 0.0])
    np.testing.assert_array_equal(view.pulled(near, 0.1), view.look_at)
    np.testing.assert_allclose(far - view.pulled(far, 0.1), [leash, 0.0, 0.0])


@pytest.mark.parametrize("name", sorted(DIRECTIONS))
def test_a_camera_looks_at_points_right_ahead_and_at_no_others(name: str) -> None:
    view = camera(name, 1.5).moved(np.array([3.0, -2.0, 1.0]), 40.0)
    right, up, forward = view.axes
    x, y, z, w = Rotation.from_matrix(np.column_stack([right, -up, forward])).as_quat()
    orientation = np.array([w, x, y, z])
    assert looks_at(view.look_at, view.position, orientation)
    assert looks_at(view.look_at + 7.0 * forward, view.position, -orientation)
    for aside in (right, -up):
        assert not looks_at(view.look_at + 0.1 * aside, view.position, orientation)
    assert not looks_at(view.position - forward, view.position, orientation)
