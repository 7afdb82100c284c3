"""Names of agents and the worst pair's distance, written where they cover no other text."""

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.picture import Picture
from phalanx.viewer.scene.view import View

Array = NDArray[np.float64]

_NODES = 24
"""Most labels at a time: each is a node of its own."""
_LETTER, _LINE = 0.013, 0.032
"""Width of a letter and height of a line, in the picture's shorter side."""


class LabelNodes:
    """The most important texts first: unsafe agents, the chosen one, the worst pair, the others."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel) -> None:
        self._model = model
        count = min(_NODES, len(model.names)) + 1
        self._nodes = [
            scene.add_label(f"/labels/{k}", "", anchor="bottom-center", visible=False)
            for k in range(count)
        ]

    def show(self, picture: Picture, selected: int | None, sizes: Array, view: View) -> None:
        """Write what there is room for; sizes of the bodies [m], shape (N,)."""
        texts, at = self._wanted(picture, selected, sizes, view)
        shown = apart(view.project(at), [len(text) for text in texts])[: len(self._nodes)]
        for node, k in zip(self._nodes, shown, strict=False):
            node.text, node.position, node.visible = texts[k], tuple(at[k]), True
        for node in self._nodes[len(shown) :]:
            node.visible = False

    def _wanted(
        self, picture: Picture, selected: int | None, sizes: Array, view: View
    ) -> tuple[list[str], Array]:
        """Texts, the most important first, and where they stand, shape (l, 3)."""
        model, up = self._model, view.axes[1]
        first = [*np.flatnonzero(picture.unsafe_agents), *([] if selected is None else [selected])]
        others = [] if model.crowded else range(len(model.names))
        agents = list(dict.fromkeys([*first, *sorted(model.agents_of([picture.pair])), *others]))
        above = picture.positions[agents] + 1.1 * sizes[agents, None] * up
        a, b = picture.worst_pair
        below = (a + b) / 2.0 - (1.6 * sizes.max() + _LINE * view.spans(a[None])) * up
        texts = [picture.worst_pair_text, *(model.names[i] for i in agents)]
        return texts, np.concatenate([below[None], above])


def apart(at: Array, letters: list[int]) -> list[int]:
    """Which texts, the first ones first, cover none of those before them.

    Args:
        at: where they stand in the picture, in its shorter sides, shape (l, 2).
        letters: how long each is.
    """
    halves = np.column_stack([_LETTER * (np.array(letters) + 1.0), np.full(len(at), _LINE)]) / 2.0
    shown: list[int] = []
    for k in range(len(at)):
        overlaps = np.abs(at[shown] - at[k]) < halves[shown] + halves[k]
        if not overlaps.all(axis=1).any():
            shown.append(k)
    return shown
