"""The selected agent: a ring around it, its name, and cameras that follow it."""

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.meshes import ring
from phalanx.viewer.scene.model import SceneModel

Array = NDArray[np.float64]

_INK = (15, 23, 42)


class SelectionNodes:
    """Nodes that mark one agent."""

    def __init__(self, server: viser.ViserServer, model: SceneModel, name_it: bool) -> None:
        """name_it: whether to write its name, which stands beside every agent in a small swarm."""
        self._server, self._names, self._name_it = server, model.names, name_it
        self._ring = server.scene.add_mesh_simple(
            "/selected", *ring(model.body), color=_INK, visible=False
        )
        self._name = server.scene.add_label("/selected/name", "", visible=False)
        self.follow = False
        """Whether the cameras move with the selected agent."""
        self._followed_from: Array | None = None

    def show(self, positions: Array, selected: int | None) -> None:
        """Mark an agent, or none; positions has shape (N, 3)."""
        self._ring.visible = selected is not None
        self._name.visible = selected is not None and self._name_it
        if selected is not None:
            self._ring.position = tuple(positions[selected])
            self._name.text = self._names[selected]
        if self.follow and selected is not None:
            self._move_cameras(positions[selected])
        else:
            self._followed_from = None

    def _move_cameras(self, target: Array) -> None:
        # By how far the agent moved, not to where it is: visitors keep the view they chose.
        if self._followed_from is not None:
            for client in self._server.get_clients().values():
                client.camera.position = client.camera.position + target - self._followed_from
        self._followed_from = target.copy()


def nearest_to_ray(positions: Array, origin: Array, direction: Array) -> int:
    """The index of the position, shape (N, 3), nearest to a ray of unit direction."""
    offsets = positions - origin
    along = offsets @ direction
    return int(np.linalg.norm(offsets - along[:, None] * direction, axis=1).argmin())
