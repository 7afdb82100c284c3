"""Ghosts: an agent's beliefs of its peers by radio, coloured by age."""

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
import trimesh
import viser

from phalanx.recording.curves.beliefs import Belief
from phalanx.theory.arrays import Array
from phalanx_viewer.scene.agents import lines
from phalanx_viewer.scene.colours import Palette, age_colour
from phalanx_viewer.scene.model import SceneModel, in_space
from phalanx_viewer.scene.nodes import HIDDEN, add_batch, ball, linear, move, ring, single, update
from phalanx_viewer.scene.picture import Kind, Shape

_FILL = 0.06
"""Opacity of a set."""
_MIDDLE = 0.5
"""Radius of the mark of a set's middle, in bodies."""
_FLAT = 0.02
"""Height of a set in the plane [m]."""
_NOTHING = np.zeros((1, 2, 3))


class GhostNodes:
    """Middles and boxes of sets, links to those that the last input counted on, and errors."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel, palette: Palette) -> None:
        n, self._edges = len(model.names), _unit_edges(2 if model.flat else 3)
        cube = trimesh.creation.box()
        box = np.asarray(cube.vertices), np.asarray(cube.faces)
        middle = ring(0.6) if model.flat else ball(model.flat)
        self._sets = add_batch(scene, "/beliefs/sets", box, n, opacity=_FILL, lit=False)
        self._middles = add_batch(scene, "/beliefs/middles", middle, n, lit=False)
        self._lines = lines(scene, "/beliefs/lines", np.tile(palette.faint, (1, 2, 1)), 1.5)
        self._errors = lines(scene, "/beliefs/errors", palette.faint, 1.0)
        self.nodes = self._sets, self._middles, self._lines, self._errors

    def show(
        self, beliefs: Sequence[Belief], positions: Array, chosen: int | None, size: float
    ) -> None:
        """Draw the chosen agent's beliefs; all positions, shape (N, 3), and a body's size [m]."""
        count, n = len(beliefs), len(positions)
        middles, sides, colours = np.zeros((n, 3)), np.full((n, 3), HIDDEN), np.zeros((n, 3))
        segments, of_ends, errors = [*_NOTHING], [(0, 0, 0)], [*_NOTHING]
        for k, belief in enumerate(beliefs):
            low, high = _box(belief)
            middles[k], sides[k] = in_space(belief.centre), np.maximum(high - low, _FLAT)
            colours[k] = age_colour(belief.age)
            drawn = [*(low + self._edges * (high - low))]
            if belief.used and chosen is not None:
                drawn.append(np.array([positions[chosen], middles[k]]))
            segments += drawn
            of_ends += [age_colour(belief.age)] * len(drawn)
            errors.append(np.array([positions[belief.peer], middles[k]]))
        sizes = np.where(np.arange(n) < count, _MIDDLE * size, HIDDEN)
        move(self._sets, middles, sides, colors=colours.astype(np.uint8))
        move(self._middles, middles, sizes, colors=colours.astype(np.uint8))
        both = np.repeat(linear(np.array(of_ends))[:, None], 2, axis=1)
        update(self._lines, points=single(np.array(segments)), colors=both)
        update(self._errors, points=single(np.array(errors)))

    def set_palette(self, palette: Palette) -> None:
        self._errors.colors = np.array(palette.faint, dtype=np.uint8)


def belief_shapes(beliefs: Sequence[Belief]) -> Iterator[Shape]:
    """Sets of beliefs."""
    for belief in beliefs:
        low, high = _box(belief)
        sides = np.maximum(high - low, _FLAT)
        yield Shape(
            "belief", belief.peer, Kind.BOX, age_colour(belief.age), 0.5 * (low + high),
            size=(sides[0], sides[1], sides[2]), opacity=2.0 * _FILL,
        )  # fmt: skip


def _box(belief: Belief) -> Array:
    """Opposite corners of a set [m], shape (2, 3)."""
    return np.array([in_space(corner) for corner in belief.corners])


def _unit_edges(axes: int) -> Array:
    """Edges of the unit square or cube, shape (e, 2, 3)."""
    corners = [
        np.array([*corner, *[0.0] * (3 - axes)]) for corner in product((0.0, 1.0), repeat=axes)
    ]
    pairs = combinations(corners, 2)
    return np.array([[a, b] for a, b in pairs if np.abs(a - b).sum() == 1.0])
