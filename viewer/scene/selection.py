"""The selected agent: a ring around it, and which agent a click means."""

import numpy as np
import viser

from phalanx.arrays import Array
from phalanx.viewer.scene.meshes import ring
from phalanx.viewer.scene.nodes import update
from phalanx.viewer.scene.palette import Palette

_AROUND = 1.12
"""Radius of the ring, in bodies: a little less than a disc's, so that it crosses no other's."""


class SelectionNodes:
    """What marks one agent."""

    def __init__(self, scene: viser.SceneApi, palette: Palette) -> None:
        self._ring = scene.add_mesh_simple(
            "/selected", *ring(0.93), color=palette.ink, visible=False, cast_shadow=False
        )

    def show(self, positions: Array, selected: int | None, sizes: Array) -> None:
        """Mark an agent, or none; positions (N, 3) and sizes of the bodies (N,) in metres."""
        self._ring.visible = selected is not None
        if selected is not None:
            self._ring.position = tuple(positions[selected])
            update(self._ring, scale=_AROUND * float(sizes[selected]))

    def set_palette(self, palette: Palette) -> None:
        """Wear the colours of a page."""
        self._ring.color = palette.ink


def nearest_to_ray(positions: Array, origin: Array, direction: Array) -> int:
    """The index of the position, shape (N, 3), nearest to a ray of unit direction."""
    offsets = positions - origin
    along = offsets @ direction
    return int(np.linalg.norm(offsets - along[:, None] * direction, axis=1).argmin())
