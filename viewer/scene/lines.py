"""Lines between and behind agents: the worst pair, link events and recent paths."""

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.picture import Picture

Array = NDArray[np.float64]

_GREY, _GREEN, _AMBER, _RED = (148, 163, 184), (34, 160, 94), (245, 158, 11), (220, 38, 38)
_NOTHING = np.zeros((1, 2, 3))
"""A line without length, for a node that has none to show."""


class LineNodes:
    """Nodes that are redrawn as a whole, one for each kind of line."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel) -> None:
        self._crowded = model.crowded
        self._above = (
            2.0 * model.body * np.array([0.0, 1.0, 0.0] if model.flat else [0.0, 0.0, 1.0])
        )
        self._paths = _lines(scene, "/recent paths", _GREY, 1.5)
        self._worst_pair = _lines(scene, "/worst pair", _GREEN, 3.0)
        self._text = scene.add_label("/worst pair/text", "", anchor="bottom-center")
        self._links = _lines(scene, "/links", _AMBER, 1.0)

    def show(self, picture: Picture, selected: int | None) -> None:
        """Redraw the worst pair and the link events; in a crowd, those of the selected agent."""
        a, b = picture.worst_pair
        self._worst_pair.points = np.array([[a, b]], dtype=np.float32)
        self._text.text = picture.worst_pair_text
        self._text.position = tuple((a + b) / 2.0 + self._above)
        links, colours = _NOTHING, np.zeros((1, 2, 3))
        shown = picture.links_of(selected) if self._crowded else np.full(len(picture.lost), True)
        if shown.any():
            links = picture.links[shown]
            colour = np.where(picture.lost[shown, None], np.array(_RED), np.array(_AMBER))
            colours = np.repeat(colour[:, None], 2, axis=1)  # of both ends
        self._links.points = links.astype(np.float32)
        self._links.colors = colours.astype(np.uint8)

    def show_recent_paths(self, positions: Array) -> None:
        """Draw paths through past positions, shape (s, N, 3)."""
        if len(positions) > 1:
            past = positions.astype(np.float32)
            self._paths.points = np.stack([past[:-1], past[1:]], axis=2).reshape(-1, 2, 3)

    def set_paths_visible(self, visible: bool) -> None:
        """Where agents were."""
        self._paths.visible = visible

    def set_links_visible(self, visible: bool) -> None:
        """Links that lost or delayed a broadcast."""
        self._links.visible = visible


def _lines(
    scene: viser.SceneApi, name: str, colour: tuple[int, int, int], pixels: float
) -> viser.LineSegmentsHandle:
    return scene.add_line_segments(
        name, _NOTHING, colour, thickness=pixels, thickness_units="screen"
    )
