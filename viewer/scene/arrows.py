"""Arrows of the applied and of the nominal inputs."""

import numpy as np
import viser

from phalanx.viewer.scene.nodes import single, update
from phalanx.viewer.scene.palette import Palette
from phalanx.viewer.scene.picture import Picture

_LONGEST, _HEAD = 3.5, 0.4
"""Lengths of the longest arrow and of an arrow's head, in bodies."""


class ArrowNodes:
    """One node for all applied inputs, and one for all nominal ones."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        nothing = np.zeros((0, 2, 3))
        self._applied = scene.add_arrows("/arrows/applied", nothing, palette.ink)
        self._u_nom = scene.add_arrows("/arrows/nominal", nothing, palette.faint)

    def show(self, picture: Picture, size: float) -> None:
        """Point them; size of a body [m]."""
        # Nominal inputs may be many times as large as any that can be applied: they are cut.
        longest = float(np.linalg.norm(picture.applied, axis=1).max())
        scale = _LONGEST * size / max(1.0, longest)
        # The applied input lies above the nominal one, which is often the same.
        for arrows, vectors, height in (
            (self._applied, scale * picture.applied, 0.9 * size),
            (self._u_nom, scale * picture.u_nom, 0.5 * size),
        ):
            lengths = np.linalg.norm(vectors, axis=1)
            seen = lengths > _HEAD * size
            cut = np.minimum(1.0, _LONGEST * size / lengths[seen])
            tails = picture.positions[seen] + [0.0, 0.0, height]
            heads = tails + cut[:, None] * vectors[seen]
            arrows.points = single(np.stack([tails, heads], axis=1))
            update(arrows, shaft_radius=0.08 * size, head_radius=0.2 * size)
            update(arrows, head_length=_HEAD * size)

    def set_palette(self, palette: Palette) -> None:
        """Wear the colours of a page."""
        self._applied.colors = np.array(palette.ink, dtype=np.uint8)
        self._u_nom.colors = np.array(palette.faint, dtype=np.uint8)

    def set_visible(self, visible: bool) -> None:
        """Show them, or hide them."""
        self._applied.visible = self._u_nom.visible = visible
