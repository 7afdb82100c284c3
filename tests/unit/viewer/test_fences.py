"""Walls that enclose are drawn as a fence: each as far as the others leave room."""

import numpy as np
from phalanx_viewer.scene.static import panel

SQUARE = [
    (np.array(normal), 5.0)
    for normal in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0])
]


def test_four_walls_make_a_fence_that_is_closed() -> None:
    ends = []
    for wall in SQUARE:
        others = [other for other in SQUARE if other is not wall]
        corners = panel(wall, others, np.array([1.0, 1.0, 0.0]), 100.0)
        ends.append({tuple(np.round(corner[:2], 9) + 0.0) for corner in corners})
    assert ends[0] == {(5.0, -5.0), (5.0, 5.0)}
    assert set.union(*ends) == {(x, y) for x in (5.0, -5.0) for y in (5.0, -5.0)}


def test_a_wall_alone_reaches_as_far_as_the_scene() -> None:
    corners = panel(SQUARE[0], [], np.array([1.0, 2.0, 3.0]), 10.0)
    np.testing.assert_allclose(corners[:, 0], 5.0)
    assert corners[:, 1].min() == -8.0
    assert corners[:, 1].max() == 12.0


def test_a_wall_beyond_another_is_not_there() -> None:
    farther = SQUARE[0][0], 7.0
    assert len(panel(farther, SQUARE, np.zeros(3), 10.0)) == 0


def test_a_floor_and_a_ceiling_bound_a_wall_in_space() -> None:
    floor, ceiling = (np.array([0.0, 0.0, -1.0]), 0.0), (np.array([0.0, 0.0, 1.0]), 3.0)
    corners = panel(SQUARE[0], [floor, ceiling, *SQUARE[2:]], np.zeros(3), 100.0)
    assert {tuple(np.round(c, 9) + 0.0) for c in corners} == {
        (5.0, y, z) for y in (-5.0, 5.0) for z in (0.0, 3.0)
    }
