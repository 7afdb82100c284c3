"""Lines between and behind agents: unsafe pairs, the worst pair, link events, recent paths."""

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.arrays import Array
from phalanx_viewer.scene.colours import DANGER, LATE, WORST_PAIR, Colour, Palette
from phalanx_viewer.scene.model import SceneModel
from phalanx_viewer.scene.nodes import single, update
from phalanx_viewer.scene.picture import Picture

_NOTHING = np.zeros((1, 2, 3))
"""A line without length, for a node with nothing to show."""


class LineNodes:
    """Nodes for lines, one for each kind; each is redrawn as a whole."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel, palette: Palette) -> None:
        self._model, self._palette = model, palette
        # viser needs a colour for each end from the start, if the node shall ever have them.
        self.paths = _lines(scene, "/recent paths", np.tile(palette.faint, (1, 2, 1)), 2.0)
        self._drops = _lines(scene, "/ground/drops", self._of_drops(palette), 1.0)
        self._worst_pair = _lines(scene, "/worst pair", WORST_PAIR, 3.0)
        self._unsafe = _lines(scene, "/unsafe pairs", DANGER, 6.0)
        self.links = _lines(scene, "/links", np.tile(LATE, (1, 2, 1)), 1.5)
        self.links.visible = False
        self._colours = np.tile(palette.faint, (len(model.names), 1))
        self._past = np.zeros((0, len(model.names), 3))

    def show(self, picture: Picture, selected: int | None) -> None:
        """Redraw pairs and link events; with many agents, events of the selected agent alone."""
        self._colours = picture.colours
        self._worst_pair.points = single(np.array([picture.worst_pair]))
        unsafe = picture.unsafe_ends if picture.unsafe else _NOTHING
        update(self._unsafe, points=single(unsafe))
        if not self._model.flat:
            p = picture.positions
            ground = np.column_stack([p[:, :2], np.full(len(p), self._model.floor)])
            self._drops.points = single(np.stack([p, ground], axis=1))
        links, colours = _NOTHING, np.zeros((1, 2, 3))
        every = np.full(len(picture.lost), True)
        shown = picture.links_of(selected) if self._model.crowded else every
        if shown.any():
            links = picture.links[shown]
            colour = np.where(picture.lost[shown, None], np.array(DANGER), np.array(LATE))
            colours = np.repeat(colour[:, None], 2, axis=1)  # of both ends
        update(self.links, points=single(links), colors=colours.astype(np.uint8))

    def show_recent_paths(self, positions: Array) -> None:
        """Draw paths through past positions, shape (s, N, 3), in the agents' colours, fading."""
        self._past = positions
        if len(positions) > 1:
            past = single(positions)
            self.paths.points = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)
            fresh = np.linspace(0.0, 1.0, len(past))[:, None, None]
            colours = fresh * self._colours + (1.0 - fresh) * np.array(self._palette.background)
            ends = np.stack([colours[:-1], colours[1:]], axis=2).reshape(-1, 2, 3)
            self.paths.colors = ends.astype(np.uint8)

    def set_palette(self, palette: Palette) -> None:
        self._palette = palette
        self._drops.colors = np.array(self._of_drops(palette), dtype=np.uint8)
        self.show_recent_paths(self._past)

    def _of_drops(self, palette: Palette) -> Colour:
        return palette.sections if self._model.crowded else palette.faint


def _lines(
    scene: viser.SceneApi, name: str, colour: Colour | NDArray[np.int_], pixels: float
) -> viser.LineSegmentsHandle:
    return scene.add_line_segments(
        name, _NOTHING, colour, thickness=pixels, thickness_units="screen"
    )
