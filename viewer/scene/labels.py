"""Names of agents and the worst pair's distance, written where they cover no other text."""

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.nodes import update
from phalanx.viewer.scene.picture import Picture
from phalanx.viewer.scene.view import View

Array = NDArray[np.float64]

_NODES = 24
"""Most labels at a time: each is a node of its own."""
_PAIR = -1
"""Whose text the worst pair's is."""
_STEADY = 0.003
"""What moves by less, in shorter sides of the picture, seems to stand still: two pixels."""
LETTER, _LINE = 0.013, 0.032
"""Width of a letter and height of a line, in the shorter side of a usual picture."""


class LabelNodes:
    """The most important texts first: unsafe agents, the chosen one, the worst pair, the others."""

    def __init__(self, scene: viser.SceneApi, model: SceneModel) -> None:
        self._model = model
        count = min(_NODES, len(model.names)) + 1
        self._free = [
            scene.add_label(f"/labels/{k}", "", anchor="center-center", visible=False)
            for k in range(count)
        ]
        self._shown: dict[int, viser.LabelHandle] = {}
        """By agent, or _PAIR: each keeps its node, and so its text, for as long as it is shown."""

    def show(self, picture: Picture, selected: int | None, sizes: Array, view: View) -> None:
        """Write what there is room for; sizes of the bodies [m], shape (N,)."""
        whose, texts, at = self._wanted(picture, selected, sizes, view)
        shown = apart(view.project(at) / view.smallness, [len(text) for text in texts])
        shown = shown[: len(self._free) + len(self._shown)]
        for gone in self._shown.keys() - {whose[k] for k in shown}:
            self._free.append(self._shown.pop(gone))
        steady = _STEADY * view.spans(at)
        for k in shown:
            node = self._shown.get(whose[k]) or self._free.pop()
            self._shown[whose[k]] = node
            update(node, text=texts[k], visible=True)
            if np.abs(at[k] - node.position).max() > steady[k]:
                node.position = tuple(at[k])
        for node in self._free:
            node.visible = False

    def _wanted(
        self, picture: Picture, selected: int | None, sizes: Array, view: View
    ) -> tuple[list[int], list[str], Array]:
        """Whose texts, and these, the most important first; where they stand, shape (l, 3)."""
        model, up = self._model, view.axes[1]
        first = [*np.flatnonzero(picture.unsafe_agents), *([] if selected is None else [selected])]
        others = [] if model.crowded else range(len(model.names))
        agents = list(dict.fromkeys([*first, *sorted(model.agents_of([picture.pair])), *others]))
        spans = view.spans(picture.positions[agents])
        clear = 1.1 * sizes[agents] + 0.5 * _LINE * view.smallness * spans
        above = picture.positions[agents] + clear[:, None] * up
        texts = [picture.worst_pair_text, *(model.names[i] for i in agents)]
        clear_of = 1.5 * float(sizes[sorted(model.agents_of([picture.pair]))].max())
        place = beside(*picture.worst_pair, len(texts[0]), clear_of, view)
        return [_PAIR, *agents], texts, np.concatenate([place[None], above])


def beside(a: Array, b: Array, letters: int, clear: float, view: View) -> Array:
    """Where the middle of a text stands beside the line from a to b [m], and off it, (3,)."""
    right, up = view.axes[:2] @ (b - a)
    # Square to the line in the picture, and downwards rather than up.
    off = np.array([up, -right]) / max(float(np.hypot(right, up)), 1e-9)
    off = -off if off[1] > 0.0 else off
    middle = (a + b) / 2.0
    span = float(view.spans(middle[None])[0])
    halves = view.smallness * span * np.array([LETTER * letters, _LINE]) / 2.0
    found: Array = middle + (clear + np.abs(off) @ halves) * off @ view.axes[:2]
    # Beside a pair at the picture's edge it would be cut off.
    at, edge = float(view.project(found[None])[0, 0]), max(1.0, view.aspect) / 2.0
    inside = max(edge - halves[0] / span, 0.0)
    found += span * (min(max(at, -inside), inside) - at) * view.axes[0]
    return found


def apart(at: Array, letters: list[int]) -> list[int]:
    """Which texts, the first ones first, cover none of those before them.

    Args:
        at: where they stand in a usual picture, in its shorter sides, shape (l, 2).
        letters: how long each is.
    """
    halves = np.column_stack([LETTER * (np.array(letters) + 1.0), np.full(len(at), _LINE)]) / 2.0
    reach = halves[:, None] + halves
    covers: list[list[bool]] = np.all(np.abs(at[:, None] - at) < reach, axis=2).tolist()
    shown: list[int] = []
    for k in range(len(at)):
        if not any(covers[k][other] for other in shown):
            shown.append(k)
    return shown
