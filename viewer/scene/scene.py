"""The 3-D scene: draws one picture after another."""

from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from phalanx.viewer.scene.agents import AgentNodes, Click
from phalanx.viewer.scene.backdrop import draw_backdrop
from phalanx.viewer.scene.lines import LineNodes
from phalanx.viewer.scene.model import SceneModel
from phalanx.viewer.scene.picture import Picture
from phalanx.viewer.scene.selection import SelectionNodes, nearest_to_ray

Array = NDArray[np.float64]


class Scene:
    """Draws pictures; knows nothing of where they come from."""

    def __init__(
        self, server: viser.ViserServer, model: SceneModel, select: Callable[[int], None]
    ) -> None:
        """Draw what never moves.

        Args:
            server: to draw on.
            model: what there is.
            select: called with an agent's index when it is clicked, in a thread of viser's.
        """
        self._server, self._select = server, select
        draw_backdrop(server, model)
        self.agents = AgentNodes(server.scene, model)
        self.lines = LineNodes(server.scene, model)
        self.selection = SelectionNodes(server, model, name_it=model.crowded)
        self._positions: Array | None = None
        self.agents.on_click(self._on_click)

    def show(self, picture: Picture, selected: int | None) -> None:
        """Draw a picture."""
        # One message to every page, so that no browser paints bodies of one instant and lines of
        # another.
        with self._server.atomic():
            self.agents.show(picture)
            self.lines.show(picture, selected)
            self.selection.show(picture.positions, selected)
        self._positions = picture.positions

    def _on_click(self, event: Click) -> None:
        if event.instance_index is not None:
            self._select(event.instance_index)
        elif self._positions is not None:
            ray = np.array(event.ray_origin), np.array(event.ray_direction)
            self._select(nearest_to_ray(self._positions, *ray))
